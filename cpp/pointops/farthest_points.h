#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace pointops {

/// Rows of points that are far from each other: the first is row 0, each next one the farthest from
/// all before; of equally far ones the lowest row. When every point is taken, row 0 repeats.
/// Skips groups of points that a new one cannot come closer to, as in Han et al., QuickFPS, 2023.
/// @param xyz    3 * n, row-major
/// @param count  how many rows to return
/// @throws std::invalid_argument if there are no points to choose from, one is not finite, or the
///         count is negative or above kMostResults
std::vector<std::int64_t> farthest_points(std::span<const float> xyz, std::int64_t count);

}  // namespace pointops
