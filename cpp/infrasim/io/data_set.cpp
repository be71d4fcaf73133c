#include "infrasim/io/data_set.h"

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

}  // namespace

void create_folder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw IoError(folder.string() + ": can't be created: " + error.message());
  remove_leftovers(folder);
}

void claim_file(const std::filesystem::path& file, const std::string& text) {
  if (std::filesystem::exists(file) || !create_file_atomically(file, text)) compare(file, text);
}

}  // namespace infrasim
