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
/// LiDAR. A LiDAR gets a warning if the step and the period of its pattern have a common factor.
/// The selection then repeats frames of the pattern earlier than with another step.
std::vector<std::string> period_warnings(const std::vector<LidarConfig>& lidars, int first,
                                         int last, int step);

}  // namespace infrasim
