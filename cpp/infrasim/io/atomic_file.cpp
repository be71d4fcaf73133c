#include "infrasim/io/atomic_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>

#include "infrasim/core/errors.h"

namespace infrasim {

namespace {

/// 0, or the errno of what failed.
int write_all(const char* path, std::span<const std::byte> bytes) {
  const int file = ::open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (file < 0) return errno;
  int failed = 0;
  while (!bytes.empty() && failed == 0) {
    const ssize_t n = ::write(file, bytes.data(), bytes.size());
    if (n > 0)
      bytes = bytes.subspan(static_cast<std::size_t>(n));
    else if (n == 0)
      failed = ENOSPC;
    else if (errno != EINTR)
      failed = errno;
  }
  if (::close(file) != 0 && failed == 0) failed = errno;
  return failed;
}

}  // namespace

void write_file_atomically(const std::filesystem::path& file, std::span<const std::byte> bytes) {
  const auto hidden = file.parent_path() / ("." + file.filename().string() + ".tmp");
  int failed = write_all(hidden.c_str(), bytes);
  if (failed == 0 && std::rename(hidden.c_str(), file.c_str()) != 0) failed = errno;
  if (failed == 0) return;
  ::unlink(hidden.c_str());
  throw IoError(file.string() + ": can't be written: " + std::strerror(failed));
}

void write_file_atomically(const std::filesystem::path& file, std::string_view text) {
  write_file_atomically(file, std::as_bytes(std::span(text)));
}

}  // namespace infrasim
