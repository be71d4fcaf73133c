#pragma once

#include <span>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"

namespace infrasim {

/// Returns warnings, one line for each unit whose table of angles in degrees looks like radians.
std::vector<std::string> angle_warnings(std::span<const LidarConfig> lidars);

}  // namespace infrasim
