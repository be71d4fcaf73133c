#pragma once

#include <filesystem>
#include <vector>

#include "infrasim/config/lidar_config.h"

namespace infrasim::config {

/// Rows `channel,elevation_deg,azimuth_offset_deg,fire_time_us` under that header, in firing
/// order. A blank offset or time is unpublished and read as 0.
/// @throws ConfigError with file and line, IoError
std::vector<Channel> read_channels(const std::filesystem::path& file);

struct FiringTable {
  std::vector<Vec2> directions;  ///< azimuth, elevation (rad)
  std::vector<double> times_s;   ///< since the first, none falls; empty without a column of times
};

/// From .npy (n, 2 or 3) float32 or float64: azimuth, elevation (rad) and time (s); or from .csv
/// with the header `azimuth_rad,elevation_rad` or `azimuth_deg,elevation_deg`, also with `,time_s`.
/// @throws ConfigError with file and line (or row), IoError
FiringTable read_firing_table(const std::filesystem::path& file);

}  // namespace infrasim::config
