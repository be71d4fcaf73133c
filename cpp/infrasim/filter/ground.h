#pragma once

#include <span>
#include <vector>

#include "infrasim/core/filter_steps.h"

namespace infrasim {

/// Returns the indices of the points to keep, in increasing order. Only returns are kept.
/// @param xyz  row-major points, metres, levelled LiDAR frame (origin at the sensor)
/// @throws std::invalid_argument if a parameter is out of its range
std::vector<int> keep(std::span<const float> xyz, const GroundHeight& ground);
std::vector<int> keep(std::span<const float> xyz, const GroundPlane& ground);
std::vector<int> keep(std::span<const float> xyz, const GroundMorphological& ground);

}  // namespace infrasim
