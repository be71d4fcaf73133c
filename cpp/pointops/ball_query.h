#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace pointops {

/// Points within balls.
struct Balls {
  std::vector<std::int64_t> rows;   ///< `limit` rows per ball; 0 for an empty ball
  std::vector<std::uint8_t> empty;  ///< one per ball, 1 if no point is inside
};

/// The first `limit` points, by row, closer than the radius to each centre. If a ball has fewer
/// points, the remaining entries repeat its first point.
/// @param points, centres  3 * n and 3 * m, row-major, metres
/// @throws std::invalid_argument if the radius or the limit is not positive, a point is not finite,
///   or the result is larger than kMostResults
Balls ball_query(std::span<const float> points, std::span<const float> centres, float radius,
                 std::int64_t limit);

}  // namespace pointops
