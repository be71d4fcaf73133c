#pragma once

#include <span>
#include <vector>

#include "infrasim/core/filter_steps.h"

namespace infrasim {

/// Returns the indices of the points to keep, in increasing order. Only returns are kept.
/// @param xyz  row-major points, metres, levelled LiDAR frame (origin at the sensor)
/// @throws std::invalid_argument if a bound is NaN, a minimum exceeds its maximum, or a polygon has
///   no area
std::vector<int> keep(std::span<const float> xyz, const CropBox& box);
std::vector<int> keep(std::span<const float> xyz, const CropPolygon& polygon);
std::vector<int> keep(std::span<const float> xyz, const CropRange& range);
std::vector<int> keep(std::span<const float> xyz, const CropFieldOfView& view);

}  // namespace infrasim
