#pragma once

#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"

namespace infrasim {

/// Returns the number of frames after which all ray directions of a LiDAR, and their times in the
/// frame, repeat.
/// @return 0 if the period is longer than `most`
int pattern_period(const LidarConfig& lidar, int most);

/// Returns warnings about a selection of frames (first to last - 1 with a step), one line per
/// LiDAR. A LiDAR has a warning if the step and its pattern's period have a common factor. The
/// selection then has fewer different frames of the pattern than the same number of frames with
/// another step.
std::vector<std::string> period_warnings(const std::vector<LidarConfig>& lidars, int first,
                                         int last, int step);

}  // namespace infrasim
