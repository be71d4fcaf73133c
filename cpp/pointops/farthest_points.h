#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace pointops {

/// Returns the row numbers of the points that farthest point sampling selects. The first selected
/// point is that of row 0. Each next point is the point with the largest distance to the nearest
/// point selected before. Of several such points, the one with the lowest row number is selected.
/// After all points have been selected, row 0 is repeated. As in Han et al., QuickFPS, 2023, a
/// group of points is skipped if a newly selected point cannot be closer to its points than the
/// points selected before.
/// @param xyz    3 * n, row-major
/// @param count  number of rows to return
/// @throws std::invalid_argument if there are no points, a point is not finite, or the count is
///   negative or above kMostResults
std::vector<std::int64_t> farthest_points(std::span<const float> xyz, std::int64_t count);

}  // namespace pointops
