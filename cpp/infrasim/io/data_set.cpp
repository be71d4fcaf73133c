#include "infrasim/io/data_set.h"

#include <sstream>
#include <vector>

#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/io/atomic_file.h"

namespace infrasim {

namespace {

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

/// @param there, wanted two texts that differ: those of the file, or what they say
/// @param old_lines of the file
[[noreturn]] void fail_at_difference(const std::filesystem::path& file, const std::string& there,
                                     const std::string& wanted,
                                     const std::vector<std::string>& old_lines) {
  const std::vector<std::string> found = lines_of(there), own = lines_of(wanted);
  const auto line_of = [](const std::vector<std::string>& lines, std::size_t i) {
    return i < lines.size() ? lines[i].substr(0, 100) : "(end)";
  };
  std::size_t i = 0;
  while (i < found.size() && i < own.size() && found[i] == own[i]) ++i;
  // A line that is not as in the file has no number there.
  const bool in_file = line_of(old_lines, i) == line_of(found, i);
  throw IoError(file.string() + ":" + (in_file ? std::to_string(i + 1) + ":" : "") +
                " the folder holds another run: found '" + line_of(found, i) + "', this run has '" +
                line_of(own, i) + "'");
}

void compare(const std::filesystem::path& file, const std::string& text, const Identity& identity) {
  const std::string there = read_file(file);
  if (there == text) return;
  std::string found, wanted;
  try {
    if (identity) {
      found = identity(there, file.string());
      wanted = identity(text, file.string());
      if (found == wanted) return;
    }
  } catch (const ConfigError&) {
    found = wanted = "";  // of a file that says nothing, the texts are compared
  }
  if (found == wanted) fail_at_difference(file, there, text, lines_of(there));
  fail_at_difference(file, found, wanted, lines_of(there));
}

}  // namespace

void create_folder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw IoError(folder.string() + ": can't be created: " + error.message());
  remove_leftovers(folder);
}

void claim_file(const std::filesystem::path& file, const std::string& text,
                const Identity& identity) {
  if (std::filesystem::exists(file) || !create_file_atomically(file, text))
    compare(file, text, identity);
}

}  // namespace infrasim
