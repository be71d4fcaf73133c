#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string_view>

namespace infrasim {

/// A file that is written piece by piece, hidden beside its place, and then put there: a reader
/// sees the whole file or none, and of several that write it at the same time the last one stays.
/// No fsync: this guards against a process that dies, not against a machine that does.
/// Each function throws IoError with the path and the system's reason.
class AtomicFile {
 public:
  explicit AtomicFile(std::filesystem::path file);
  /// Removes what was written unless it was put in its place.
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  void write(std::span<const std::byte> bytes);
  void write(std::string_view text);
  /// Puts the file in its place, where another may be.
  void replace();
  /// Puts the file in its place if none is there.
  /// @return whether it did
  bool create();

 private:
  void close();

  std::filesystem::path file_;
  std::filesystem::path hidden_;
  int descriptor_ = -1;
};

/// Writes a file at once.
/// @throws IoError
void write_file_atomically(const std::filesystem::path& file, std::span<const std::byte> bytes);
void write_file_atomically(const std::filesystem::path& file, std::string_view text);

/// As above, but what is there already stays.
/// @return whether the file is the one written
bool create_file_atomically(const std::filesystem::path& file, std::string_view text);

/// Removes the hidden files that processes of this machine left in a folder when they died.
void remove_leftovers(const std::filesystem::path& folder);

}  // namespace infrasim
