#include "infrasim/io/data_set.h"

#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <span>
#include <sstream>

#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/io/atomic_file.h"

namespace infrasim {

namespace {

void compare(const std::filesystem::path& file, const std::string& text) {
  const std::string there = read_file(file);
  if (there == text) return;
  std::istringstream old_lines(there), new_lines(text);
  std::string old_line, new_line;
  int line = 0;
  do {
    ++line;
    if (!std::getline(old_lines, old_line)) old_line = "(end)";
    if (!std::getline(new_lines, new_line)) new_line = "(end)";
  } while (old_line == new_line && old_line != "(end)");
  throw IoError(file.string() + ":" + std::to_string(line) +
                ": the folder holds another run: found '" + old_line.substr(0, 100) +
                "', this run has '" + new_line.substr(0, 100) + "'");
}

/// A hidden name beside the file that no other process uses.
std::filesystem::path process_file(const std::filesystem::path& file) {
  return file.parent_path() / ("." + file.filename().string() + "." + std::to_string(::getpid()));
}

}  // namespace

void create_folder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw IoError(folder.string() + ": can't be created: " + error.message());
}

void replace_file(const std::filesystem::path& file, const std::string& text) {
  const auto mine = process_file(file);
  write_file_atomically(mine, text);
  if (std::rename(mine.c_str(), file.c_str()) == 0) return;
  const int failed = errno;
  ::unlink(mine.c_str());
  throw IoError(file.string() + ": can't be written: " + std::strerror(failed));
}

void claim_file(const std::filesystem::path& file, const std::string& text) {
  if (std::filesystem::exists(file)) return compare(file, text);
  // A link fails where a rename would replace the file of a process that was first.
  const auto mine = process_file(file);
  write_file_atomically(mine, text);
  const int failed = ::link(mine.c_str(), file.c_str()) == 0 ? 0 : errno;
  ::unlink(mine.c_str());
  if (failed == EEXIST) return compare(file, text);
  if (failed != 0) throw IoError(file.string() + ": " + std::strerror(failed));
}

}  // namespace infrasim
