#include "pointops/ball_query.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <stdexcept>

#include "pointops/limits.h"

namespace pointops {

namespace {

/// The rows of points in each square cell of a horizontal grid. The grid has at most about four
/// cells per point.
class Cells {
 public:
  Cells(std::span<const float> points, float at_least) {
    const std::size_t n = points.size() / 3;
    float high_x = -std::numeric_limits<float>::infinity(), high_y = high_x;
    for (std::size_t i = 0; i < n; ++i) {
      low_x_ = std::min(low_x_, points[3 * i]);
      low_y_ = std::min(low_y_, points[3 * i + 1]);
      high_x = std::max(high_x, points[3 * i]);
      high_y = std::max(high_y, points[3 * i + 1]);
    }
    const double width = double{high_x} - low_x_, height = double{high_y} - low_y_;
    const auto cells = static_cast<double>(4 * n + 16);
    // A cell is slightly larger than the radius, so that rounding never misses a point.
    size_ = std::max(
        {1.001 * at_least, std::sqrt(width * height / cells), width / cells, height / cells});
    columns_ = static_cast<std::int64_t>(width / size_) + 1;
    lines_ = static_cast<std::int64_t>(height / size_) + 1;

    starts_.assign(static_cast<std::size_t>(columns_ * lines_) + 1, 0);
    std::vector<std::size_t> cell(n);
    for (std::size_t i = 0; i < n; ++i) {
      cell[i] =
          static_cast<std::size_t>(line(points[3 * i + 1]) * columns_ + column(points[3 * i]));
      ++starts_[cell[i] + 1];
    }
    for (std::size_t c = 1; c < starts_.size(); ++c) starts_[c] += starts_[c - 1];
    std::vector<std::size_t> next(starts_.begin(), starts_.end() - 1);
    rows_.resize(n);
    for (std::size_t i = 0; i < n; ++i) rows_[next[cell[i]]++] = static_cast<std::int64_t>(i);
  }

  /// Calls visit(row) for all points in the cell that contains x, y and in the neighbouring cells.
  template <typename Visit>
  void around(float x, float y, const Visit& visit) const {
    const std::int64_t first = std::clamp<std::int64_t>(column(x) - 1, 0, columns_);
    const std::int64_t end = std::clamp<std::int64_t>(column(x) + 2, 0, columns_);
    const std::int64_t last_line = std::min(line(y) + 2, lines_);
    for (std::int64_t l = std::max<std::int64_t>(line(y) - 1, 0); l < last_line; ++l)
      for (std::size_t i = starts_[static_cast<std::size_t>(l * columns_ + first)];
           i < starts_[static_cast<std::size_t>(l * columns_ + end)]; ++i)
        visit(rows_[i]);
  }

 private:
  std::int64_t column(float x) const { return cell_of(double{x} - low_x_); }
  std::int64_t line(float y) const { return cell_of(double{y} - low_y_); }
  // Positions far outside the grid are clamped, so that the result fits into int64. This does not
  // change the results, because no points are near such positions.
  std::int64_t cell_of(double along) const {
    return static_cast<std::int64_t>(std::floor(std::clamp(along / size_, -9.0, 1e15)));
  }

  float low_x_ = std::numeric_limits<float>::infinity();
  float low_y_ = std::numeric_limits<float>::infinity();
  double size_ = 1;
  std::int64_t columns_ = 0, lines_ = 0;
  /// index in rows_ of the start of each cell, line by line, and of the end of the last cell
  std::vector<std::size_t> starts_;
  std::vector<std::int64_t> rows_;  ///< rows of points, cell by cell; increasing within a cell
};

}  // namespace

Balls ball_query(std::span<const float> points, std::span<const float> centres, float radius,
                 std::int64_t limit) {
  if (!(radius > 0))
    throw std::invalid_argument("radius: expected a number above 0, got 0 or less, or NaN");
  check_between("limit", limit, 1, kMostResults);
  const auto finite = [](float v) { return std::isfinite(v); };
  if (!std::all_of(points.begin(), points.end(), finite) ||
      !std::all_of(centres.begin(), centres.end(), finite))
    throw std::invalid_argument("points, centres: expected finite values, got NaN or inf");
  const std::size_t balls = centres.size() / 3, most = static_cast<std::size_t>(limit);
  checked_product("centres x limit", {static_cast<std::int64_t>(balls), limit}, kMostResults);
  Balls result;
  result.rows.assign(balls * most, 0);
  result.empty.assign(balls, 1);
  if (points.empty()) return result;

  const Cells cells(points, radius);
  std::vector<std::int64_t> inside;
  for (std::size_t b = 0; b < balls; ++b) {
    const auto centre = centres.subspan(3 * b, 3);
    inside.clear();
    cells.around(centre[0], centre[1], [&](std::int64_t row) {
      const auto point = points.subspan(3 * static_cast<std::size_t>(row), 3);
      const float dx = point[0] - centre[0], dy = point[1] - centre[1], dz = point[2] - centre[2];
      if (dx * dx + dy * dy + dz * dz < radius * radius) inside.push_back(row);
    });
    if (inside.empty()) continue;
    const std::size_t count = std::min(inside.size(), most);
    std::partial_sort(inside.begin(), inside.begin() + static_cast<std::ptrdiff_t>(count),
                      inside.end());
    const auto out = std::span(result.rows).subspan(b * most, most);
    std::fill(out.begin(), out.end(), inside.front());
    std::copy_n(inside.begin(), count, out.begin());
    result.empty[b] = 0;
  }
  return result;
}

}  // namespace pointops
