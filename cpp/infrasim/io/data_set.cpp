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

/// Throws an error about the first different line.
/// @param there, of_run two texts that differ: the files' texts or their identities
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
                "', this run has '" + line_of(in_run, i) + "'");
}

void compare(const std::filesystem::path& file, const std::string& text, const Identity& identity) {
  const std::string there = read_file(file);
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

constexpr std::size_t kPiece = 1 << 20;  // number of bytes per write

/// Compares a text that arrives in pieces with a file.
class Comparison {
 public:
  explicit Comparison(const std::filesystem::path& file)
      : name_(file.string()), there_(file, std::ios::binary) {
    if (!there_) throw IoError(name_ + ": can't be read");
  }

  void take(std::string_view piece) {
    std::string there(piece.size(), '\0');
    there_.read(there.data(), static_cast<std::streamsize>(there.size()));
    there.resize(static_cast<std::size_t>(there_.gcount()));
    const auto same =
        static_cast<std::size_t>(std::ranges::mismatch(piece, there).in1 - piece.begin());
    pass(piece.substr(0, same));
    if (same == piece.size()) return;
    std::string rest;
    if (there.find('\n', same) == std::string::npos) std::getline(there_, rest);
    fail(there.substr(same) + rest, std::string(piece.substr(same)));
  }

  void end() {
    std::string rest;
    if (there_.peek() == std::ifstream::traits_type::eof()) return;
    std::getline(there_, rest);
    fail(rest, "");
  }

 private:
  void pass(std::string_view same) {
    line_ += static_cast<int>(std::ranges::count(same, '\n'));
    const auto last = same.rfind('\n');
    if (last == std::string_view::npos)
      begun_ += same;
    else
      begun_ = same.substr(last + 1);
  }

  [[noreturn]] void fail(const std::string& there, const std::string& in_run) const {
    const auto line = [&](const std::string& rest) {
      const std::string text = begun_ + rest.substr(0, rest.find('\n'));
      return text.empty() && rest.empty() ? std::string("(end)") : text.substr(0, 100);
    };
    throw IoError(name_ + ":" + std::to_string(line_) + ": the folder holds another run: it has '" +
                  line(there) + "', this run has '" + line(in_run) + "'");
  }

  std::string name_;
  std::ifstream there_;
  int line_ = 1;
  std::string begun_;  ///< start of the current line, which both texts have
};

}  // namespace

void create_folder(const std::filesystem::path& folder) {
  std::error_code error;
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

void claim_file(const std::filesystem::path& file,
                const std::function<void(const TakeText&)>& give_all) {
  if (!std::filesystem::exists(file)) {
    AtomicFile out(file);
    std::string text;
    give_all([&](std::string_view piece) {
      text += piece;
      if (text.size() < kPiece) return;
      out.write(text);
      text.clear();
    });
    out.write(text);
    if (out.create()) return;
  }
  Comparison comparison(file);
  give_all([&](std::string_view piece) { comparison.take(piece); });
  comparison.end();
}

}  // namespace infrasim
