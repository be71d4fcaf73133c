#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace pointops {

/// Points in balls.
struct Balls {
  std::vector<std::int64_t> rows;   ///< limit per ball; those of an empty ball are 0
  std::vector<std::uint8_t> empty;  ///< one per ball, 1 where no point is inside
};

/// The first `limit` points, by row, closer than the radius to each centre. A ball with fewer is
/// filled up with its first point.
/// @param points, centres  3 * n and 3 * m, row-major, metres
/// @throws std::invalid_argument if the radius or the limit is not positive, a point not finite, or
///         the result larger than kMostResults
Balls ball_query(std::span<const float> points, std::span<const float> centres, float radius,
                 std::int64_t limit);

}  // namespace pointops
