#pragma once

#include <span>
#include <vector>

#include "infrasim/core/filter_steps.h"

namespace infrasim {

/// Indices of the points to keep, in increasing order, without points that are no returns.
/// @param xyz  row-major points, metres, levelled LiDAR frame (origin at the sensor)
/// @throws std::invalid_argument if a parameter is out of its range
std::vector<int> keep(std::span<const float> xyz, const GroundHeight& ground);
std::vector<int> keep(std::span<const float> xyz, const GroundPlane& ground);
std::vector<int> keep(std::span<const float> xyz, const GroundMorphological& ground);

}  // namespace infrasim
