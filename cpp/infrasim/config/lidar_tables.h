#pragma once

#include <filesystem>
#include <vector>

#include "infrasim/config/lidar_config.h"

namespace infrasim::config {

/// Reads rows `channel,elevation_deg,azimuth_offset_deg,fire_time_us` in firing order, with that
/// header. A blank offset or time means unpublished and is read as 0.
/// @throws ConfigError with file and line, IoError
std::vector<Channel> read_channels(const std::filesystem::path& file);

struct FiringTable {
  std::vector<Vec2> directions;  ///< azimuth, elevation (rad)
  /// since the first, not decreasing; empty without a column of times
  std::vector<double> times_s;
};

/// Reads a table of rays from .npy or .csv. A .npy holds (n, 2) or (n, 3) float32 or float64:
/// azimuth, elevation (rad) and time (s). A .csv has the header `azimuth_rad,elevation_rad` or
/// `azimuth_deg,elevation_deg`, optionally with `,time_s`.
/// @throws ConfigError with file and line (or row), IoError
FiringTable read_firing_table(const std::filesystem::path& file);

}  // namespace infrasim::config
