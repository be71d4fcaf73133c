#pragma once

#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"

namespace infrasim {

/// Frames after which a LiDAR's pattern is the same again: all directions, and their times in the
/// frame.
/// @return 0 if that takes more than so many frames
int pattern_period(const LidarConfig& lidar, int most);

/// Of frames first to last - 1 by a step: LiDARs of whose patterns they show fewer frames than as
/// many others would, because the step and the pattern's period have a factor in common; a line
/// each.
std::vector<std::string> period_warnings(const std::vector<LidarConfig>& lidars, int first,
                                         int last, int step);

}  // namespace infrasim
