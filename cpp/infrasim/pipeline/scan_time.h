#pragma once

#include <span>
#include <vector>

#include "infrasim/config/lidar_config.h"

namespace infrasim {

/// Mean time of one object's returns. If a pause longer than `cut_s` splits them into two groups,
/// as the cut angle of a turn does, it is the mean of the larger group, or of the first one if both
/// are equal.
/// @param times_s since the start of the frame, at least one; sorted by this function if they are
///   split
double scan_time_s(std::span<double> times_s, double cut_s);

/// The minimum pause (s) in an object's returns that counts as a split at the cut angle: half a
/// turn of the slowest spinning unit. If a frame holds several turns it is half a frame, so that
/// each pass over an object stays whole. Infinite without a spinning unit.
double cut_s(const LidarConfig& lidar);

}  // namespace infrasim
