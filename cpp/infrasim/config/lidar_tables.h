#pragma once

#include <filesystem>
#include <vector>

#include "infrasim/config/lidar_config.h"

namespace infrasim::config {

/// Reads a table with the header `channel,elevation_deg,azimuth_offset_deg,fire_time_us`, in firing
/// order. A blank offset or time means that the value is unpublished; it is read as 0. The columns
/// `column_step`, `first_column`, `range_at_10_percent_m` and `min_range_m` may follow. A blank
/// cell in one of these four columns has the same effect as a missing column.
/// @throws ConfigError with file and line, IoError
std::vector<Channel> read_channels(const std::filesystem::path& file);

struct FiringTable {
  std::vector<Vec2> directions;  ///< azimuth and elevation of each ray, in radians
  /// times since the first ray, never decreasing; empty if the file has no column of times
  std::vector<double> times_s;
};

/// Reads a table of rays from .npy or .csv. A .npy file has an array (n, 2) or (n, 3) of float32 or
/// float64 with the columns azimuth, elevation (rad) and, optionally, time (s). A .csv file has the
/// header `azimuth_rad,elevation_rad` or `azimuth_deg,elevation_deg`, optionally with `,time_s`.
/// @throws ConfigError with file and line (or row), IoError
FiringTable read_firing_table(const std::filesystem::path& file);

}  // namespace infrasim::config
