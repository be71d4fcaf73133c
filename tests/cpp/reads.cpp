#include "reads.h"

#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>

namespace infrasim::testing {

thread_local int reads_left = -1;

}  // namespace infrasim::testing

/// Replaces the function of the C library, so that tests can have a disk with an error.
extern "C" ssize_t read(int file, void* bytes, std::size_t count) {
  int& left = infrasim::testing::reads_left;
  if (left == 0) {
    errno = EIO;
    return -1;
  }
  if (left > 0) --left;
  return ::syscall(SYS_read, file, bytes, count);
}
