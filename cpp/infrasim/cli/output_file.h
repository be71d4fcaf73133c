#pragma once

#include <filesystem>

namespace infrasim::cli {

/// Refuses an output file that the command has read.
/// @param option the option of the output file, for the message
/// @throws ConfigError
void refuse_input(const char* option, const std::filesystem::path& file);

}  // namespace infrasim::cli
