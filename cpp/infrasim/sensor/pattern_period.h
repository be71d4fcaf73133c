#pragma once

#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"

namespace infrasim {

/// Number of frames after which a LiDAR's pattern repeats, with all directions and their times in
/// the frame.
/// @return 0 if the period is longer than `most`
int pattern_period(const LidarConfig& lidar, int most);

/// Warnings for frames first to last - 1 with a step, one line per LiDAR. A LiDAR is listed if
/// these frames show fewer different frames of its pattern than the same number of frames could,
/// because the step and the pattern's period have a common factor.
std::vector<std::string> period_warnings(const std::vector<LidarConfig>& lidars, int first,
                                         int last, int step);

}  // namespace infrasim
