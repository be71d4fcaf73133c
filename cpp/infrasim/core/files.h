#pragma once

#include <filesystem>
#include <string>

namespace infrasim {

/// All bytes of a file. @throws IoError if it can't be read
std::string read_file(const std::filesystem::path& file);

}  // namespace infrasim
