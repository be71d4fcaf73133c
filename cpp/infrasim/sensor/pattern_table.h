#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/sensor/scan_pattern.h"

namespace infrasim {

/// Name of the random stream of one unit of a LiDAR.
std::string stream_name(const LidarConfig& lidar, std::size_t unit);

/// Time by which the motors of a LiDAR's unit are ahead of the run, drawn from the seed; 0 if the
/// LiDAR's random phase is off.
double start_phase_s(std::uint64_t seed, const LidarConfig& lidar, std::size_t unit);

/// Azimuth, elevation (rad) and time (s) of every ray of every step-th frame in [first, last), row
/// by row, group by group; sensor frame. Phase 0 unless a seed is given.
std::vector<double> pattern_table(const LidarConfig& lidar, int first, int last, int step,
                                  std::optional<std::uint64_t> seed);

/// Of each unit, in its own frame.
/// @throws ConfigError, with the LiDAR's name, for rays that can't be traced
std::vector<FieldOfView> fields_of_view(const LidarConfig& lidar);

}  // namespace infrasim
