#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <string_view>

namespace infrasim {

/// Writes a hidden file beside its place and renames it: a reader sees the whole file or none.
/// No fsync: this guards against a process that dies, not against a machine that does.
/// @throws IoError with the path and the system's reason; the hidden file is removed
void write_file_atomically(const std::filesystem::path& file, std::span<const std::byte> bytes);
void write_file_atomically(const std::filesystem::path& file, std::string_view text);

}  // namespace infrasim
