#include "infrasim/io/atomic_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <string>

#include "infrasim/core/errors.h"

namespace infrasim {

namespace {

constexpr std::string_view kEnding = ".tmp";

std::string host() {
  std::array<char, 65> name{};
  ::gethostname(name.data(), name.size() - 1);
  return name.data();
}

/// .NAME.HOST.PID.COUNT.tmp: no other process and no other write has it.
std::filesystem::path hidden_file(const std::filesystem::path& file) {
  static const std::string kHost = host();
  static std::atomic<unsigned> count = 0;
  const std::string name = file.filename().string().substr(0, 100);  // a system allows 255 bytes
  return file.parent_path() / ("." + name + "." + kHost + "." + std::to_string(::getpid()) + "." +
                               std::to_string(count++) + std::string(kEnding));
}

/// The process that a hidden file's name holds if it is of this machine, else 0.
pid_t writer_of(std::string_view name) {
  const auto last_part = [&] {
    const auto dot = std::min(name.rfind('.'), name.size());
    const std::string_view part = name.substr(std::min(dot + 1, name.size()));
    name = name.substr(0, dot);
    return part;
  };
  if (!name.starts_with('.') || !name.ends_with(kEnding)) return 0;
  name.remove_suffix(kEnding.size());
  last_part();
  const std::string_view digits = last_part();
  pid_t pid = 0;
  std::from_chars(digits.data(), digits.data() + digits.size(), pid);
  return name.ends_with("." + host()) ? pid : 0;
}

/// 0, or the errno of what failed.
int write_all(const char* path, std::span<const std::byte> bytes) {
  const int file = ::open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
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

[[noreturn]] void fail(const std::filesystem::path& file, int error) {
  throw IoError(file.string() + ": can't be written: " + std::strerror(error));
}

/// @return the hidden file with these bytes, for this writer alone
std::filesystem::path write_hidden(const std::filesystem::path& file,
                                   std::span<const std::byte> bytes) {
  std::filesystem::path hidden;
  int failed = EEXIST;
  while (failed == EEXIST) {  // left by a process that had this one's number
    hidden = hidden_file(file);
    failed = write_all(hidden.c_str(), bytes);
  }
  if (failed == 0) return hidden;
  ::unlink(hidden.c_str());
  fail(file, failed);
}

}  // namespace

void write_file_atomically(const std::filesystem::path& file, std::span<const std::byte> bytes) {
  const auto hidden = write_hidden(file, bytes);
  if (std::rename(hidden.c_str(), file.c_str()) == 0) return;
  const int failed = errno;
  ::unlink(hidden.c_str());
  fail(file, failed);
}

void write_file_atomically(const std::filesystem::path& file, std::string_view text) {
  write_file_atomically(file, std::as_bytes(std::span(text)));
}

bool create_file_atomically(const std::filesystem::path& file, std::string_view text) {
  // A link fails where a rename would replace the file of a process that was first.
  const auto hidden = write_hidden(file, std::as_bytes(std::span(text)));
  const int failed = ::link(hidden.c_str(), file.c_str()) == 0 ? 0 : errno;
  ::unlink(hidden.c_str());
  if (failed != 0 && failed != EEXIST) fail(file, failed);
  return failed == 0;
}

void remove_leftovers(const std::filesystem::path& folder) {
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
    const pid_t writer = writer_of(entry.path().filename().string());
    if (writer > 0 && ::kill(writer, 0) != 0 && errno == ESRCH) ::unlink(entry.path().c_str());
  }
}

}  // namespace infrasim
