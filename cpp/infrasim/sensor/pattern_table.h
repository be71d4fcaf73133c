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

inline constexpr const char* kUsualMount = "pole";  // as the catalogue's scenes have it

/// Time by which the motors of a LiDAR's unit are ahead of where a lock would hold them: 0 if they
/// are locked, else a draw of the seed, the mount and the unit's number. All LiDARs of a mount have
/// the same draw, so that none is better by luck.
double start_phase_s(std::uint64_t seed, const std::string& mount, const LidarConfig& lidar,
                     std::size_t unit);

/// Azimuth, elevation (rad) and time (s) of every ray of every step-th frame in [first, last), row
/// by row, group by group; sensor frame. Motors start as a lock would hold them, unless a seed is
/// given: then free ones start as a run of this seed has them at the mount.
std::vector<double> pattern_table(const LidarConfig& lidar, int first, int last, int step,
                                  std::optional<std::uint64_t> seed,
                                  const std::string& mount = kUsualMount);

/// Of each unit, in its own frame.
/// @throws ConfigError, with the LiDAR's name, for rays that can't be traced
std::vector<FieldOfView> fields_of_view(const LidarConfig& lidar);

}  // namespace infrasim
