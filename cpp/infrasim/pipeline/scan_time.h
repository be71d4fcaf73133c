#pragma once

#include <span>
#include <vector>

#include "infrasim/config/lidar_config.h"

namespace infrasim {

/// Returns the mean time of one object's returns. If a pause longer than `cut_s` splits the returns
/// into two groups, the result is the mean time of the larger group, or of the first group if both
/// are equally large. The cut angle of a spinning LiDAR makes such a pause.
/// @param times_s at least one time since the start of the frame; the function sorts the times if
///   they are split
double scan_time_s(std::span<double> times_s, double cut_s);

/// Returns the minimum pause (s) in an object's returns that counts as a split at the cut angle. It
/// is half a turn of a spinning unit. It is infinite without a spinning unit.
double cut_s(const LidarConfig& lidar);

}  // namespace infrasim
