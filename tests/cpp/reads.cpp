#include "reads.h"

#include <fcntl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>

namespace infrasim::testing {

thread_local int reads_left = -1;
thread_local int link_error = 0, rename_error = 0;

namespace {

int fail(int error) {
  errno = error;
  return -1;
}

}  // namespace

}  // namespace infrasim::testing

// These functions replace those of the C library, so that tests can have a disk with an error, or a
// file system without hard links.

extern "C" ssize_t read(int file, void* bytes, std::size_t count) {
  int& left = infrasim::testing::reads_left;
  if (left == 0) return infrasim::testing::fail(EIO);
  if (left > 0) --left;
  return ::syscall(SYS_read, file, bytes, count);
}

extern "C" int link(const char* file, const char* name) noexcept {
  if (const int error = infrasim::testing::link_error) return infrasim::testing::fail(error);
  return static_cast<int>(::syscall(SYS_linkat, AT_FDCWD, file, AT_FDCWD, name, 0));
}

extern "C" int renameat2(int folder, const char* file, int new_folder, const char* name,
                         unsigned flags) noexcept {
  if (const int error = infrasim::testing::rename_error) return infrasim::testing::fail(error);
  return static_cast<int>(::syscall(SYS_renameat2, folder, file, new_folder, name, flags));
}
