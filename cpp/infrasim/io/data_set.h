#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>

namespace infrasim {

/// Creates a folder and those above it, and removes what runs that died left in it.
/// @throws IoError
void create_folder(const std::filesystem::path& folder);

/// Holds a folder against other processes that lock it, as long as it lives; where the file system
/// has no locks, against none.
class FolderLock {
 public:
  explicit FolderLock(const std::filesystem::path& folder);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int descriptor_;
};

/// What the text of a file, which is named for messages, says of the frames beside it.
/// @throws ConfigError if it can't be read
using Identity = std::function<std::string(const std::string& text, const std::string& file)>;

/// Writes a file that says what a folder holds, or checks that one is there that says the same:
/// the same text, or another of the same identity, which stays.
/// Safe against other processes that claim the same folder at the same time.
/// @throws IoError if it can't be written, or is there and says something else (names the first
///         line)
void claim_file(const std::filesystem::path& file, const std::string& text,
                const Identity& identity = {});

/// Takes the next piece of a text.
using TakeText = std::function<void(std::string_view)>;
/// The same for a text too long to be held: `give_all` hands it over, whole lines at a time, and
/// may be asked twice.
void claim_file(const std::filesystem::path& file,
                const std::function<void(const TakeText&)>& give_all);

}  // namespace infrasim
