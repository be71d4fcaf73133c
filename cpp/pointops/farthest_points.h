#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace pointops {

/// Farthest point sampling. The first row is row 0. Each next row is the point farthest from all
/// previous ones, the lowest row if several are equally far. When all points are taken, row 0
/// repeats. Groups of points that a new point cannot be closer to are skipped, as in Han et al.,
/// QuickFPS, 2023.
/// @param xyz    3 * n, row-major
/// @param count  number of rows to return
/// @throws std::invalid_argument if there are no points, a point is not finite, or the count is
///   negative or above kMostResults
std::vector<std::int64_t> farthest_points(std::span<const float> xyz, std::int64_t count);

}  // namespace pointops
