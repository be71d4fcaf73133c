#include "infrasim/io/data_set.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <fstream>
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

/// Throws an error that shows the first line in which two texts differ.
/// @param there, of_run texts of the existing file and of the run, or their identities
/// @param old_lines lines of the existing file
[[noreturn]] void fail_at_difference(const std::filesystem::path& file, const std::string& there,
                                     const std::string& of_run,
                                     const std::vector<std::string>& old_lines) {
  const std::vector<std::string> in_folder = lines_of(there), in_run = lines_of(of_run);
  const auto line_of = [](const std::vector<std::string>& lines, std::size_t i) {
    return i < lines.size() ? lines[i].substr(0, 100) : "(end)";
  };
  std::size_t i = 0;
  while (i < in_folder.size() && i < in_run.size() && in_folder[i] == in_run[i]) ++i;
  // An identity can have lines that the file does not have. For them the message has no line
  // number.
  const bool in_file = line_of(old_lines, i) == line_of(in_folder, i);
  throw IoError(file.string() + ":" + (in_file ? std::to_string(i + 1) + ":" : "") +
                " the folder holds another run: it has '" + line_of(in_folder, i) +
                "', this run has '" + line_of(in_run, i) + "'; use another folder");
}

void compare(const std::filesystem::path& file, const std::string& text, const Identity& identity) {
  const std::string there = unix_text(read_file(file));  // an editor may have changed the line ends
  if (there == text) return;
  std::string in_folder, of_run;
  try {
    if (identity) {
      in_folder = identity(there, file.string());
      of_run = identity(text, file.string());
      if (in_folder == of_run) return;
    }
  } catch (const ConfigError&) {
    in_folder = of_run = "";  // without an identity, the texts are compared
  }
  if (in_folder == of_run) fail_at_difference(file, there, text, lines_of(there));
  fail_at_difference(file, in_folder, of_run, lines_of(there));
}

}  // namespace

void create_folder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::path path = folder;
  while (!std::filesystem::exists(path, error) && path.has_relative_path())
    path = path.parent_path();
  if (std::filesystem::exists(path, error) && !std::filesystem::is_directory(path, error))
    throw IoError(path.string() + ": expected a folder, got a file");
  std::filesystem::create_directories(folder, error);
  if (error) throw IoError(folder.string() + ": can't be created: " + error.message());
  remove_leftovers(folder);
}

FolderLock::FolderLock(const std::filesystem::path& folder)
    : descriptor_(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)) {
  while (descriptor_ >= 0 && ::flock(descriptor_, LOCK_EX) != 0 && errno == EINTR) continue;
}

FolderLock::~FolderLock() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

void claim_file(const std::filesystem::path& file, const std::string& text,
                const Identity& identity) {
  if (std::filesystem::exists(file) || !create_file_atomically(file, text))
    compare(file, text, identity);
}

}  // namespace infrasim
