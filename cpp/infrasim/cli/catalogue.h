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

inline constexpr const char* kRateHelp =
    "frames per second of the LiDARs, 5 to 20; default: that of their files";
inline constexpr const char* kLawExponentHelp =
    "power of the reflectance with which the range grows in full sun, 0.25 to 0.5, for LiDARs of "
    "which only one range is published";

inline constexpr const char* kEchoHelp =
    "echoes of a ray that become points: strongest, first, last or dual; default: that of the "
    "LiDAR "
    "files";

/// Command-line values that replace values in LiDAR files.
struct LidarChanges {
  std::optional<double> rate_hz;
  std::optional<double> law_exponent;
  std::optional<std::string> echo;
};

/// Returns a copy of a LiDAR with values from the command line. Warns if `law_exponent` has no
/// effect on the LiDAR.
LidarConfig with_changes(LidarConfig lidar, const LidarChanges& changes);

/// Reads the LiDAR that a command-line argument names, and applies `changes`.
LidarConfig lidar_of(const std::string& word, const std::string& preset,
                     const LidarChanges& changes);

}  // namespace infrasim::cli
