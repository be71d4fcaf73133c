#include "infrasim/core/files.h"

#include <sys/stat.h>

#include <cerrno>
#include <fstream>
#include <mutex>
#include <set>
#include <sstream>
#include <system_error>
#include <utility>

#include "infrasim/core/errors.h"

namespace infrasim {

namespace {

namespace fs = std::filesystem;

using FileNumber = std::pair<dev_t, ino_t>;

/// The files that this process has opened to read. Nothing is recorded before `on` is set.
struct ReadRecord {
  std::mutex mutex;
  bool on = false;
  std::set<FileNumber> files;
};

ReadRecord& read_record() {
  static ReadRecord record;
  return record;
}

/// Returns the device and inode numbers of a file, or 0 and 0 if the file does not exist.
FileNumber number_of(const fs::path& file) {
  struct stat found{};
  return ::stat(file.c_str(), &found) == 0 ? FileNumber{found.st_dev, found.st_ino} : FileNumber{};
}

const char* kind_of(fs::file_type type) {
  switch (type) {
    case fs::file_type::fifo:
      return "a FIFO";
    case fs::file_type::block:
    case fs::file_type::character:
      return "a device";
    case fs::file_type::socket:
      return "a socket";
    default:
      return nullptr;
  }
}

}  // namespace

void expect_regular(const fs::path& file) {
  std::error_code error;
  if (const char* kind = kind_of(fs::status(file, error).type()))
    throw ConfigError(file.string() + ": expected a regular file, got " + kind);
}

std::ifstream open_file(const fs::path& file) {
  if (has_zero(file)) throw IoError("(file): expected a path without a zero byte, got one with it");
  expect_regular(file);
  errno = 0;
  std::ifstream in(file, std::ios::binary);
  const int reason = in.is_open() ? EISDIR : errno;
  std::error_code error;
  if (!in.is_open() || fs::is_directory(file, error))
    throw IoError(file.string() + ": can't be read: " + std::generic_category().message(reason));
  ReadRecord& record = read_record();
  const std::scoped_lock lock(record.mutex);
  if (record.on) record.files.insert(number_of(file));
  return in;
}

std::string read_file(const fs::path& file, std::uintmax_t most) {
  std::ifstream in = open_file(file);
  std::error_code error;
  const std::uintmax_t size = fs::file_size(file, error);
  if (!error && size > most)
    throw ConfigError(file.string() + ": expected at most " + std::to_string(most >> 20) +
                      " MiB, got " + std::to_string(size >> 20) + " MiB");
  std::ostringstream bytes;
  // Reading an empty file would set the stream's fail bit.
  if (in && in.peek() != std::ifstream::traits_type::eof()) bytes << in.rdbuf();
  // An error while the bytes are copied sets a bit of `bytes`, not of `in`.
  if (in.bad() || !bytes) throw IoError(file.string() + ": can't be read");
  return std::move(bytes).str();
}

std::string unix_text(std::string text) {
  if (text.starts_with(kByteOrderMark)) text.erase(0, kByteOrderMark.size());
  std::size_t kept = 0;
  for (std::size_t i = 0; i < text.size(); ++i)
    if (text[i] != '\r' || i + 1 == text.size() || text[i + 1] != '\n') text[kept++] = text[i];
  text.resize(kept);
  return text;
}

std::vector<fs::path> entries_of(const fs::path& folder, std::error_code& error) {
  std::vector<fs::path> entries;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error))
    entries.push_back(entry->path());
  return entries;
}

void record_read_files() {
  ReadRecord& record = read_record();
  const std::scoped_lock lock(record.mutex);
  record.on = true;
}

bool was_read(const fs::path& file) {
  ReadRecord& record = read_record();
  const std::scoped_lock lock(record.mutex);
  return record.files.contains(number_of(file));
}

}  // namespace infrasim
