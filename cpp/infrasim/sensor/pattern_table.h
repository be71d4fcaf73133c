#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/sensor/field_of_view.h"
#include "infrasim/sensor/scan_pattern.h"

namespace infrasim {

inline constexpr const char* kUsualMount = "pole";  // name of the mount in the catalogue's scenes

/// Returns the time by which the motors of a LiDAR's unit are ahead of their locked phase. The time
/// is 0 for locked motors. For free motors it is a random sample that depends on the seed, the
/// mount and the unit's number. All LiDARs of a mount have the same sample, so that none has an
/// advantage by chance.
double start_phase_s(std::uint64_t seed, const std::string& mount, const LidarConfig& lidar,
                     std::size_t unit);

/// Returns the azimuth, elevation (rad) and time (s) of every ray of every step-th frame in [first,
/// last), in the sensor frame. The three values of a ray are consecutive. The rays are ordered by
/// unit of the LiDAR, then by frame, then by their number in the unit's pattern. Without a seed,
/// all motors start at their locked phase. With a seed, free motors start as in a run with this
/// seed at the mount.
std::vector<double> pattern_table(const LidarConfig& lidar, int first, int last, int step,
                                  std::optional<std::uint64_t> seed,
                                  const std::string& mount = kUsualMount);

/// Returns the field of view of each unit of a LiDAR, in the frame of the unit.
/// @throws ConfigError, with the LiDAR's name, if a prism reflects a ray totally
std::vector<FieldOfView> fields_of_view(const LidarConfig& lidar);

}  // namespace infrasim
