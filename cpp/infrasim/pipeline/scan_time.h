#pragma once

#include <span>
#include <vector>

#include "infrasim/config/lidar_config.h"

namespace infrasim {

/// Returns the mean time of one object's returns. If a pause longer than `cut_s` splits the returns
/// into two groups, the result is the mean time of the larger group, or of the first group if both
/// are equally large. Such a pause occurs if the object is at the cut angle of a spinning LiDAR,
/// where frames begin and end.
/// @param times_s at least one time since the start of the frame; the function sorts the times if
///   they are split
double scan_time_s(std::span<double> times_s, double cut_s);

/// Returns the minimum pause (s) in an object's returns that counts as a split at the cut angle.
/// The pause is half a turn of a spinning unit, and infinite for a LiDAR without such a unit.
double cut_s(const LidarConfig& lidar);

}  // namespace infrasim
