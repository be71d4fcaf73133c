#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace pointops {

/// The rows of the points within each ball.
struct Balls {
  std::vector<std::int64_t> rows;   ///< `limit` rows per ball; all are 0 for an empty ball
  std::vector<std::uint8_t> empty;  ///< 1 for each ball without points, otherwise 0
};

/// Returns, for each centre, the first `limit` points that are closer than the radius. The points
/// are in the order of their rows. If a ball has fewer points, the remaining entries repeat its
/// first point.
/// @param points, centres  3 * n and 3 * m, row-major, metres
/// @throws std::invalid_argument if the radius or the limit is not positive, a point is not finite,
///   or the result is larger than kMostResults
Balls ball_query(std::span<const float> points, std::span<const float> centres, float radius,
                 std::int64_t limit);

}  // namespace pointops
