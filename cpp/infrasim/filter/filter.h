#pragma once

#include <functional>
#include <span>
#include <vector>

#include "infrasim/filter/background.h"

namespace infrasim {

// Each of the following functions returns the indices of the points to keep, in increasing order.
// Only returns are kept. `xyz` has row-major points in the levelled LiDAR frame, in metres. The
// functions throw std::invalid_argument if a parameter is out of its range, such as NaN, a minimum
// above its maximum, or a polygon without an area.
std::vector<int> keep(std::span<const float> xyz, const CropBox& box);
std::vector<int> keep(std::span<const float> xyz, const CropPolygon& polygon);
std::vector<int> keep(std::span<const float> xyz, const CropRange& range);
std::vector<int> keep(std::span<const float> xyz, const CropFieldOfView& view);
std::vector<int> keep(std::span<const float> xyz, const GroundHeight& ground);
std::vector<int> keep(std::span<const float> xyz, const GroundPlane& ground);
std::vector<int> keep(std::span<const float> xyz, const GroundMorphological& ground);

using FilterStep = FilterOf<BackgroundModel>;

/// Returns the indices of the points that one step keeps, in increasing order. Points that are not
/// returns (NaN, infinite, or 0 0 0) are never kept.
/// @param xyz  row-major points, metres, levelled LiDAR frame (origin at the sensor)
/// @throws std::invalid_argument if a parameter of the step is out of its range
std::vector<int> apply(const FilterStep& step, std::span<const float> xyz);

/// Returns the indices of the points that all steps keep. Each step receives only the points that
/// the previous steps have kept. Without steps, all returns are kept.
/// @param observer called after each step with the number of points before and after it
using StepObserver =
    std::function<void(const FilterStep& step, std::size_t before, std::size_t after)>;
std::vector<int> keep_all(std::span<const FilterStep> steps, std::span<const float> xyz,
                          const StepObserver& observer = {});

/// Returns whether a ground-plane step found no plane. If it finds a plane, it removes at least the
/// points of the plane.
inline bool has_no_plane(const FilterStep& step, std::size_t before, std::size_t after) {
  return std::holds_alternative<GroundPlane>(step) && after == before;
}

}  // namespace infrasim
