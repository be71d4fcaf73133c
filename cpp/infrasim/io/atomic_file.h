#pragma once

#include <filesystem>
#include <string_view>

namespace infrasim {

/// A file that is written in pieces under a hidden name in the same folder, and then renamed. A
/// reader sees either the complete file or no file. If several processes write the file at the same
/// time, the last file replaces the others. The class calls no fsync. It protects against a crash
/// of the process, but not against a crash of the machine. If the path is a symbolic link, its
/// target is written. Each function throws IoError with the path and the system's reason. The
/// constructor throws ConfigError for a FIFO, a device or a socket.
class AtomicFile {
 public:
  explicit AtomicFile(std::filesystem::path file);
  /// Removes the hidden file unless it was renamed.
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  void write(std::string_view bytes);
  /// Renames the file to its final name, replacing an existing file.
  void replace();
  /// Renames the file to its final name if no such file exists.
  /// @return whether the file was renamed
  bool create();

 private:
  void close();

  std::filesystem::path file_;
  std::filesystem::path hidden_;
  int descriptor_ = -1;
};

/// Writes a file in one call.
/// @throws IoError
void write_file_atomically(const std::filesystem::path& file, std::string_view bytes);

/// Like write_file_atomically, but does not replace an existing file.
/// @return whether the file was written
bool create_file_atomically(const std::filesystem::path& file, std::string_view text);

/// Removes hidden files in a folder that crashed processes of this machine left behind.
void remove_leftovers(const std::filesystem::path& folder);

}  // namespace infrasim
