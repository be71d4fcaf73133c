#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>

#include "infrasim/core/math.h"
#include "infrasim/filter/filter.h"
#include "infrasim/filter/points.h"

namespace infrasim {

namespace {

constexpr float kNone = std::numeric_limits<float>::infinity();

/// A grid of heights; kNone where the height is unknown.
struct HeightGrid {
  int rows = 0;
  int columns = 0;
  std::vector<float> z;  ///< heights, row-major

  HeightGrid(int row_count, int column_count)
      : rows(row_count),
        columns(column_count),
        z(static_cast<std::size_t>(row_count) * column_count, kNone) {}
  float& at(int row, int column) { return z[static_cast<std::size_t>(row) * columns + column]; }
  std::span<float> line(int row) {
    return std::span(z).subspan(static_cast<std::size_t>(row) * columns, columns);
  }
};

/// The lowest heights of the points, in a map of square cells and in polar cells along the rays.
struct GroundGrids {
  double cell_m;
  HeightGrid map;   ///< grid with rows along x and columns along y
  HeightGrid rays;  ///< grid with a row per azimuth and columns along the horizontal range

  GroundGrids(int cells_out, const GroundMorphological& ground)
      : cell_m(ground.cell_m),
        map(2 * cells_out, 2 * cells_out),
        rays(static_cast<int>(std::ceil(360 / ground.azimuth_cell_deg)), cells_out) {}

  double centre(int cell) const {
    const int middle = map.rows / 2;
    return (cell - middle + 0.5) * cell_m;
  }
  float& on_map(Vec3 p) {
    return map.at(static_cast<int>(std::floor(p.x / cell_m)) + map.rows / 2,
                  static_cast<int>(std::floor(p.y / cell_m)) + map.rows / 2);
  }
  /// Returns the polar cell of a position; null beyond the farthest point.
  float* on_ray(double x, double y) {
    const int column = static_cast<int>(math::hypot(x, y) / cell_m);
    const double turn = math::atan2(y, x) / (2 * kPi) + 0.5;
    const int row = std::min(static_cast<int>(turn * rays.rows), rays.rows - 1);
    return column < rays.columns ? &rays.at(row, column) : nullptr;
  }
};

/// Fills the gaps of a ray. A gap is filled linearly between its two returns, with one exception.
/// If the height falls nearly as steeply as the line of sight, the nearer return may hide lower
/// ground. In that case the gap has the height of its near end over the length of the previous gap,
/// and then the height of its far end. Behind the last return, the height is constant: the minimum,
/// over all returns, of the return's height plus kRoadSlope times its distance from the last
/// return.
void fill_ray(std::span<float> ray, double cell_m) {
  constexpr double kShortGap_m = 2, kShadowShare = 0.8, kRoadSlope = 0.06;
  const int n = static_cast<int>(ray.size());
  int before = -1, last = -1;
  float road = kNone, road_at_last = kNone;
  for (int i = 0; i < n; ++i) {
    road = std::min(road + static_cast<float>(kRoadSlope * cell_m), ray[i]);
    if (ray[i] == kNone) continue;
    const float from = last < 0 ? ray[i] : ray[last];
    const int gap = i - last;
    const double sight_fall = gap / (i + 0.5) * -ray[i];  // fall of the line of sight over the gap
    const bool shadow = gap * cell_m > kShortGap_m && from - ray[i] > kShadowShare * sight_fall;
    const int level_until = shadow ? last + (last - before) : last;
    for (int k = last + 1; k < i; ++k) {
      const auto share = static_cast<float>(k - last) / static_cast<float>(gap);
      ray[k] = k <= level_until ? from : shadow ? ray[i] : from + (ray[i] - from) * share;
    }
    before = last;
    last = i;
    road_at_last = road;
  }
  std::fill(ray.begin() + last + 1, ray.end(), road_at_last);
}

/// Fills the empty cells of the map with the heights of the filled rays.
void fill_map(GroundGrids& grids) {
  for (int r = 0; r < grids.rays.rows; ++r) fill_ray(grids.rays.line(r), grids.cell_m);
  for (int r = 0; r < grids.map.rows; ++r)
    for (int c = 0; c < grids.map.columns; ++c) {
      if (grids.map.at(r, c) != kNone) continue;
      const float* z = grids.on_ray(grids.centre(r), grids.centre(c));
      if (z) grids.map.at(r, c) = *z;
    }
}

/// Sets out[i] to the best of the values in[i - half] to in[i + half]. better(a, b) returns whether
/// the value a is better than b: less for minima, greater for maxima. Indices outside the vector
/// are ignored.
template <class Better>
void slide(const std::vector<float>& in, int half, Better better, std::vector<int>& queue,
           std::vector<float>& out) {
  const int n = static_cast<int>(in.size());
  int head = 0, tail = 0;  // ends of a queue of indices, whose values get worse from head to tail
  for (int next = 0, i = 0; i < n; ++i) {
    for (; next < n && next <= i + half; ++next) {
      while (tail > head && !better(in[queue[tail - 1]], in[next])) --tail;
      queue[tail++] = next;
    }
    while (queue[head] < i - half) ++head;
    out[i] = in[queue[head]];
  }
}

/// Replaces each cell by the best height in its window of (2 half + 1) x (2 half + 1) cells.
template <class Better>
void slide_windows(HeightGrid& grid, int half, Better better) {
  std::vector<float> in, out;
  std::vector<int> queue;
  const auto along = [&](int lines, int cells, auto&& cell) {
    in.resize(cells), out.resize(cells), queue.resize(cells);
    for (int line = 0; line < lines; ++line) {
      for (int i = 0; i < cells; ++i) in[i] = cell(line, i);
      slide(in, half, better, queue, out);
      for (int i = 0; i < cells; ++i) cell(line, i) = out[i];
    }
  };
  along(grid.rows, grid.columns, [&](int r, int c) -> float& { return grid.at(r, c); });
  along(grid.columns, grid.rows, [&](int c, int r) -> float& { return grid.at(r, c); });
}

/// Applies a grey opening: each cell gets the highest of the minima of all windows that contain the
/// cell.
void open_windows(HeightGrid& grid, int half) {
  slide_windows(grid, half, std::less<>());
  for (float& z : grid.z)
    if (z == kNone) z = -kNone;  // a window without returns must not be the highest
  slide_windows(grid, half, std::greater<>());
}

void check(const GroundMorphological& ground) {
  if (!(std::isfinite(ground.cell_m) && std::isfinite(ground.window_m) &&
        ground.window_m >= ground.cell_m && ground.height_m > 0 && ground.cell_m > 0 &&
        ground.azimuth_cell_deg >= 0.01 && ground.azimuth_cell_deg <= 180 &&
        ground.max_range_m > 0 && ground.max_range_m / ground.cell_m <= 2000))
    throw std::invalid_argument(
        "ground_morphological: sizes must be positive and finite, the window at least a cell, the "
        "azimuth "
        "cell in [0.01, 180] degrees, and the range at most 2000 cells");
}

}  // namespace

std::vector<int> keep(std::span<const float> xyz, const GroundMorphological& ground) {
  check(ground);
  const auto in_height_band = [&](Vec3 p) {
    return is_return(p) && math::hypot(p.x, p.y) <= ground.max_range_m;
  };
  double farthest_m = 0;
  for (std::size_t i = 0; i < point_count(xyz); ++i)
    if (const Vec3 p = point_at(xyz, i); in_height_band(p))
      farthest_m = std::max(farthest_m, math::hypot(p.x, p.y));

  GroundGrids grids(static_cast<int>(farthest_m / ground.cell_m) + 1, ground);
  for (std::size_t i = 0; i < point_count(xyz); ++i) {
    const Vec3 p = point_at(xyz, i);
    if (!in_height_band(p)) continue;
    for (float* z : {&grids.on_map(p), grids.on_ray(p.x, p.y)})
      *z = std::min(*z, static_cast<float>(p.z));
  }
  fill_map(grids);
  // A window that is wider than the map has the same effect as a window that covers the map.
  const double half = std::min(ground.window_m / 2 / ground.cell_m, 1.0 * grids.map.rows);
  open_windows(grids.map, static_cast<int>(std::lround(half)));
  return keep_if(
      xyz, [&](Vec3 p) { return !in_height_band(p) || p.z - grids.on_map(p) > ground.height_m; });
}

}  // namespace infrasim
