#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace pointops {

/// Returns rows of points by farthest point sampling. The first row is row 0. Each next row is the
/// point that is farthest from all previous points. Of equally far points, the lowest row is used.
/// After all points have been returned, row 0 is repeated. As in Han et al., QuickFPS, 2023, a
/// group of points is skipped if a new point cannot be closer to it than the previous points.
/// @param xyz    3 * n, row-major
/// @param count  number of rows to return
/// @throws std::invalid_argument if there are no points, a point is not finite, or the count is
///   negative or above kMostResults
std::vector<std::int64_t> farthest_points(std::span<const float> xyz, std::int64_t count);

}  // namespace pointops
