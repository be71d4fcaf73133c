#pragma once

#include <span>
#include <vector>

#include "infrasim/config/lidar_config.h"

namespace infrasim {

/// Time of one vehicle's returns: their mean. Where more than `cut_s` parts them in two groups, as
/// where the cut angle of a turn splits the vehicle, that of the larger group, of equal ones the
/// first.
/// @param times_s since the start of the frame, at least one; they are sorted if they are parted
double scan_time_s(std::span<double> times_s, double cut_s);

/// The pause in the returns from a vehicle, in seconds, from which on the cut angle splits it: half
/// a turn of the slowest spinning unit. Of faster ones, whose frames hold several turns, half a
/// frame, so that whole looks at a vehicle stay together. Infinite without a spinning unit.
double cut_s(const LidarConfig& lidar);

}  // namespace infrasim
