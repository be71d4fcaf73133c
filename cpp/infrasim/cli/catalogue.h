#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"

namespace infrasim::cli {

/// Resolves a command-line argument to a file. An argument with a '/' or a '.' is a path. Any other
/// argument is a name in the catalogue that comes with the program, such as `livox_avia` in
/// `lidars`.
/// @param kinds folders of the catalogue, searched in this order
/// @throws ConfigError if the name is unknown; the message lists the known names
std::filesystem::path config_file(const std::string& word, const std::vector<std::string>& kinds);

inline constexpr const char* kLawExponentHelp =
    "power of the reflectance with which the range grows in full sun, 0.25 to 0.5, for LiDARs of "
    "which only one range is published";

/// Reads a LiDAR and sets the exponent of its detection law. Warns if its published ranges
/// determine the exponent.
LidarConfig lidar_with_exponent(const std::filesystem::path& file, const std::string& preset,
                                const std::optional<double>& law_exponent);

}  // namespace infrasim::cli
