#pragma once

#include <span>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"

namespace infrasim {

/// Returns a warning for each LiDAR unit
/// - whose table should have degrees but probably has radians;
/// - whose table of directions has a free phase (a random start) but repeats within a second. A
///   table of one turn of a spinning LiDAR gives no warning;
/// - whose sub-rays are so far apart that they miss targets.
std::vector<std::string> lidar_warnings(std::span<const LidarConfig> lidars);

}  // namespace infrasim
