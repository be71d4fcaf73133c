#include "pointops/farthest_points.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>
#include <stdexcept>

#include "pointops/limits.h"

namespace pointops {

namespace {

using Point = std::array<float, 3>;

// maximum number of points per group; small groups are skipped more often, large groups have faster
// loops
constexpr std::size_t kGroup = 128;

/// The input points in groups of neighbouring points. For each input point, the struct stores the
/// distance to the nearest point that has been selected so far.
struct Groups {
  std::array<std::vector<float>, 3> xyz;
  std::vector<std::int64_t> rows;   ///< row numbers of the points in the caller's array
  std::vector<float> apart;         ///< squared distance to the nearest selected point
  std::vector<std::size_t> starts;  ///< start of each group, and end of the last group
  std::vector<Point> low, high;     ///< bounds of a group
  std::vector<float> farthest;      ///< largest `apart` of a group
};

/// Splits the points at the median along the longest side of their bounding box, until each part
/// has at most kGroup points.
void split(std::span<const float> xyz, std::span<std::int64_t> rows, std::size_t start,
           Groups& groups) {
  Point low, high;
  low.fill(std::numeric_limits<float>::infinity());
  high.fill(-std::numeric_limits<float>::infinity());
  for (const std::int64_t row : rows)
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float value = xyz[3 * static_cast<std::size_t>(row) + axis];
      low[axis] = std::min(low[axis], value);
      high[axis] = std::max(high[axis], value);
    }
  if (rows.size() <= kGroup) {
    groups.starts.push_back(start);
    groups.low.push_back(low);
    groups.high.push_back(high);
    return;
  }
  std::size_t longest = 0;
  for (std::size_t axis = 1; axis < 3; ++axis)
    if (high[axis] - low[axis] > high[longest] - low[longest]) longest = axis;
  const std::size_t half = rows.size() / 2;
  std::nth_element(rows.begin(), rows.begin() + static_cast<std::ptrdiff_t>(half), rows.end(),
                   [&](std::int64_t a, std::int64_t b) {
                     return xyz[3 * static_cast<std::size_t>(a) + longest] <
                            xyz[3 * static_cast<std::size_t>(b) + longest];
                   });
  split(xyz, rows.first(half), start, groups);
  split(xyz, rows.subspan(half), start + half, groups);
}

Groups grouped(std::span<const float> xyz) {
  const std::size_t n = xyz.size() / 3;
  Groups groups;
  groups.rows.resize(n);
  std::iota(groups.rows.begin(), groups.rows.end(), 0);
  split(xyz, groups.rows, 0, groups);
  groups.starts.push_back(n);
  // Points are sorted by row number within a group. Of several points at the same distance, the
  // point with the lowest row number therefore comes first.
  for (std::size_t g = 0; g + 1 < groups.starts.size(); ++g)
    std::sort(groups.rows.begin() + static_cast<std::ptrdiff_t>(groups.starts[g]),
              groups.rows.begin() + static_cast<std::ptrdiff_t>(groups.starts[g + 1]));
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (const std::int64_t row : groups.rows)
      groups.xyz[axis].push_back(xyz[3 * static_cast<std::size_t>(row) + axis]);
  groups.apart.assign(n, std::numeric_limits<float>::infinity());
  groups.farthest.assign(groups.low.size(), std::numeric_limits<float>::infinity());
  return groups;
}

/// Returns the squared distance from the chosen point to the bounds of a group. The operations have
/// the same order as for the distance between two points. Rounding therefore never makes the result
/// larger than the distance to a point inside the bounds.
float apart_from_group(const Groups& groups, std::size_t g, const Point& chosen) {
  Point gap;
  for (std::size_t axis = 0; axis < 3; ++axis)
    gap[axis] =
        std::max({groups.low[g][axis] - chosen[axis], chosen[axis] - groups.high[g][axis], 0.0F});
  return gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2];
}

void choose(Groups& groups, std::size_t g, const Point& chosen) {
  const float* x = groups.xyz[0].data();
  const float* y = groups.xyz[1].data();
  const float* z = groups.xyz[2].data();
  float* apart = groups.apart.data();
  float farthest = 0;
  for (std::size_t i = groups.starts[g]; i < groups.starts[g + 1]; ++i) {
    const float dx = x[i] - chosen[0], dy = y[i] - chosen[1], dz = z[i] - chosen[2];
    const float now = dx * dx + dy * dy + dz * dz;
    apart[i] = now < apart[i] ? now : apart[i];
    farthest = apart[i] > farthest ? apart[i] : farthest;
  }
  groups.farthest[g] = farthest;
}

/// Returns the position in `groups` of the farthest point. Of equally far points, the point with
/// the lowest row number is returned.
std::size_t farthest_position(const Groups& groups) {
  const float most = *std::max_element(groups.farthest.begin(), groups.farthest.end());
  std::size_t best = groups.rows.size();
  for (std::size_t g = 0; g < groups.farthest.size(); ++g) {
    if (groups.farthest[g] != most) continue;
    std::size_t i = groups.starts[g];
    while (groups.apart[i] != most) ++i;
    if (best == groups.rows.size() || groups.rows[i] < groups.rows[best]) best = i;
  }
  return best;
}

}  // namespace

std::vector<std::int64_t> farthest_points(std::span<const float> xyz, std::int64_t count) {
  if (xyz.empty()) throw std::invalid_argument("xyz: expected at least one point, got none");
  check_between("count", count, 0, kMostResults);
  if (!std::all_of(xyz.begin(), xyz.end(), [](float v) { return std::isfinite(v); }))
    throw std::invalid_argument("xyz: expected finite values, got NaN or inf");
  Groups groups = grouped(xyz);
  std::vector<std::int64_t> chosen;
  Point point{xyz[0], xyz[1], xyz[2]};
  for (std::int64_t row = 0; static_cast<std::int64_t>(chosen.size()) < count;) {
    chosen.push_back(row);
    for (std::size_t g = 0; g < groups.farthest.size(); ++g)
      if (apart_from_group(groups, g, point) < groups.farthest[g]) choose(groups, g, point);
    const std::size_t next = farthest_position(groups);
    row = groups.rows[next];
    point = {groups.xyz[0][next], groups.xyz[1][next], groups.xyz[2][next]};
  }
  return chosen;
}

}  // namespace pointops
