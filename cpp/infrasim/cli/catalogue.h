#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace infrasim::cli {

/// Resolves a command-line argument to a file. An argument with a '/' or a '.' is a path. Any other
/// argument is a name in the catalogue that comes with the program, such as `livox_avia` in
/// `lidars`.
/// @param kinds folders of the catalogue, searched in this order
/// @throws ConfigError if the name is unknown; the message lists the known names
std::filesystem::path config_file(const std::string& word, const std::vector<std::string>& kinds);

}  // namespace infrasim::cli
