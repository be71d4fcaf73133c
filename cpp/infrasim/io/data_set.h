#pragma once

#include <filesystem>
#include <functional>
#include <string>

namespace infrasim {

/// Creates a folder and those above it, and removes what runs that died left in it.
/// @throws IoError
void create_folder(const std::filesystem::path& folder);

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

}  // namespace infrasim
