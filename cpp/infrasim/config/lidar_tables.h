#pragma once

#include <filesystem>
#include <vector>

#include "infrasim/config/lidar_config.h"

namespace infrasim::config {

/// Rows `channel,elevation_deg,azimuth_offset_deg,fire_time_us` under that header, in firing
/// order. A blank offset or time is unpublished and read as 0.
/// @throws ConfigError with file and line, IoError
std::vector<Channel> read_channels(const std::filesystem::path& file);

/// Azimuth and elevation in radians, from .npy (n, 2) float32 or float64, or .csv with the header
/// `azimuth_rad,elevation_rad`.
/// @throws ConfigError with file and line (or row), IoError
std::vector<Vec2> read_directions(const std::filesystem::path& file);

}  // namespace infrasim::config
