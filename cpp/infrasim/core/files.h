#pragma once

#include <filesystem>
#include <fstream>
#include <string>

namespace infrasim {

/// Whether a path contains a zero byte, at which system calls would cut it off.
inline bool has_zero(const std::filesystem::path& file) {
  return file.native().find('\0') != std::string::npos;
}

/// Opens a file to read its bytes.
/// @throws IoError if it can't be read
std::ifstream open_file(const std::filesystem::path& file);

/// All bytes of a file.
/// @throws IoError if it can't be read
std::string read_file(const std::filesystem::path& file);

}  // namespace infrasim
