#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace infrasim::cli {

/// The file that a word of the command line means: a path if it holds a '/' or a '.', else a name
/// of the catalogue that came with the program, such as `livox_avia` of `lidars`.
/// @param kinds folders of the catalogue that are asked, one after the other
/// @throws ConfigError for a name that is not there; it lists those that are
std::filesystem::path config_file(const std::string& word, const std::vector<std::string>& kinds);

}  // namespace infrasim::cli
