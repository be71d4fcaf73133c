#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>

namespace infrasim {

/// Creates a folder and its parents, and removes files that crashed runs left in it.
/// @throws IoError
void create_folder(const std::filesystem::path& folder);

/// Locks a folder against other processes that use this class, as long as the object exists. The
/// lock has no effect on a file system without locks.
class FolderLock {
 public:
  explicit FolderLock(const std::filesystem::path& folder);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int descriptor_;
};

/// Function that returns the identity of a folder's frames: the part of a file's text that
/// determines the frames. `file` is the name of the file for messages.
/// @throws ConfigError if the text can't be read
using Identity = std::function<std::string(const std::string& text, const std::string& file)>;

/// Writes a file that identifies the content of a folder, or checks the existing file. An existing
/// file must have the same text or the same identity, and is not changed. Several processes may
/// claim the same folder at the same time.
/// @throws IoError if the file can't be written, or if it exists with another content; the message
///   shows the first different line
void claim_file(const std::filesystem::path& file, const std::string& text,
                const Identity& identity = {});

}  // namespace infrasim
