#pragma once

#include <filesystem>
#include <string>

namespace infrasim {

/// Creates a folder and those above it, and removes what runs that died left in it.
/// @throws IoError
void create_folder(const std::filesystem::path& folder);

/// Writes a file that says what a folder holds, or checks that one with the same text is there.
/// Safe against other processes that claim the same folder at the same time.
/// @throws IoError if it can't be written, or is there with another text (names the first line)
void claim_file(const std::filesystem::path& file, const std::string& text);

}  // namespace infrasim
