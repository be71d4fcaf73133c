#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string_view>

namespace infrasim {

/// Writes a hidden file beside its place and renames it: a reader sees the whole file or none, and
/// of several that write it at the same time the last one stays. No fsync: this guards against a
/// process that dies, not against a machine that does.
/// @throws IoError with the path and the system's reason; the hidden file is removed
void write_file_atomically(const std::filesystem::path& file, std::span<const std::byte> bytes);
void write_file_atomically(const std::filesystem::path& file, std::string_view text);

/// As above, but what is there already stays.
/// @return whether the file is the one written
bool create_file_atomically(const std::filesystem::path& file, std::string_view text);

/// Removes the hidden files that processes of this machine left in a folder when they died.
void remove_leftovers(const std::filesystem::path& folder);

}  // namespace infrasim
