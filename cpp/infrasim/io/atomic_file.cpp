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
#include <utility>

#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"

namespace infrasim {

namespace {

constexpr std::string_view kEnding = ".tmp";

std::string host() {
  std::array<char, 65> name{};
  ::gethostname(name.data(), name.size() - 1);
  return name.data();
}

/// Returns the hidden name .NAME.HOST.PID.COUNT.tmp, which is unique among processes and writes.
std::filesystem::path hidden_file(const std::filesystem::path& file) {
  static const std::string kHost = host();
  static std::atomic<unsigned> count = 0;
  // file systems allow names of 255 bytes
  const std::string name = file.filename().string().substr(0, 100);
  return file.parent_path() / ("." + name + "." + kHost + "." + std::to_string(::getpid()) + "." +
                               std::to_string(count++) + std::string(kEnding));
}

/// Returns the file to which a path leads through symbolic links. The target need not exist.
/// @throws ConfigError if the links form a loop
std::filesystem::path link_target(const std::filesystem::path& path) {
  constexpr int kMostLinks = 40;  // maximum number of links in a chain, as in the Linux kernel
  std::filesystem::path target = path;
  std::error_code error;
  for (int links = 0; std::filesystem::is_symlink(std::filesystem::symlink_status(target, error));
       ++links) {
    if (links == kMostLinks)
      throw ConfigError(path.string() + ": expected a file, got a loop of symbolic links");
    const std::filesystem::path next = std::filesystem::read_symlink(target, error);
    if (error) return target;
    target = target.parent_path() / next;
  }
  return target;
}

/// Returns the process id in the name of a hidden file of this machine; 0 for any other file.
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

/// Renames a file if its new name does not exist, on a file system without hard links.
/// @return 0, or the error of the system
int rename_to_new(const std::filesystem::path& file, const std::filesystem::path& name) {
  if (::renameat2(AT_FDCWD, file.c_str(), AT_FDCWD, name.c_str(), RENAME_NOREPLACE) == 0) return 0;
  if (errno != EINVAL && errno != ENOSYS && errno != EOPNOTSUPP) return errno;
  std::error_code error;
  if (std::filesystem::exists(std::filesystem::symlink_status(name, error))) return EEXIST;
  return std::rename(file.c_str(), name.c_str()) == 0 ? 0 : errno;
}

[[noreturn]] void fail(const std::filesystem::path& file, int error) {
  throw IoError(file.string() + ": can't be written: " + std::strerror(error));
}

}  // namespace

AtomicFile::AtomicFile(std::filesystem::path file) : file_(std::move(file)) {
  if (has_zero(file_))
    throw IoError("(file): expected a path without a zero byte, got one with it");
  file_ = link_target(file_);
  expect_regular(file_);
  do {
    hidden_ = hidden_file(file_);
    descriptor_ = ::open(hidden_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  } while (descriptor_ < 0 && errno == EEXIST);  // an earlier process with this id left the file
  if (descriptor_ < 0) fail(file_, errno);
}

AtomicFile::~AtomicFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
  ::unlink(hidden_.c_str());
}

void AtomicFile::write(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t n = ::write(descriptor_, bytes.data(), bytes.size());
    if (n > 0)
      bytes.remove_prefix(static_cast<std::size_t>(n));
    else if (n == 0)
      fail(file_, ENOSPC);
    else if (errno != EINTR)
      fail(file_, errno);
  }
}

void AtomicFile::close() {
  if (::close(std::exchange(descriptor_, -1)) != 0) fail(file_, errno);
}

void AtomicFile::replace() {
  close();
  if (std::rename(hidden_.c_str(), file_.c_str()) != 0) fail(file_, errno);
}

bool AtomicFile::create() {
  close();
  // A link fails if the file exists; a rename would replace another process's file.
  int failed = ::link(hidden_.c_str(), file_.c_str()) == 0 ? 0 : errno;
  if (failed == EPERM || failed == EOPNOTSUPP || failed == ENOSYS || failed == EMLINK)
    failed = rename_to_new(hidden_, file_);
  if (failed != 0 && failed != EEXIST) fail(file_, failed);
  return failed == 0;
}

void write_file_atomically(const std::filesystem::path& file, std::string_view bytes) {
  AtomicFile out(file);
  out.write(bytes);
  out.replace();
}

bool create_file_atomically(const std::filesystem::path& file, std::string_view text) {
  AtomicFile out(file);
  out.write(text);
  return out.create();
}

void remove_leftovers(const std::filesystem::path& folder) {
  std::error_code error;
  for (const std::filesystem::path& file : entries_of(folder, error)) {
    const pid_t writer = writer_of(file.filename().string());
    if (writer > 0 && ::kill(writer, 0) != 0 && errno == ESRCH) ::unlink(file.c_str());
  }
}

}  // namespace infrasim
