#include "pointops/suppression.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <stdexcept>
#include <string>

namespace pointops {

namespace {

/// Smaller overlaps count as 0. The limit is relative to the squared size of the larger box.
constexpr double kRounding = 4 * std::numeric_limits<double>::epsilon();

struct Footprint {
  double x, y, length, width, heading, cos, sin, reach;

  explicit Footprint(std::span<const double> box)
      : x(box[0]),
        y(box[1]),
        length(box[3]),
        width(box[4]),
        heading(box[6]),
        cos(std::cos(heading)),
        sin(std::sin(heading)),
        reach(std::hypot(length, width) / 2) {}

  double area() const { return length * width; }
};

/// Returns the mean of clip(x, -limit, limit) for x from start to end.
double mean_clipped(double start, double end, double limit) {
  const double first = std::min(start, end), last = std::max(start, end);
  const double middle = (std::clamp(first, -limit, limit) + std::clamp(last, -limit, limit)) / 2;
  const double span = last > first ? last - first : 1;
  const double above = std::clamp((last - limit) / span, 0.0, 1.0);
  const double below = std::clamp((-limit - first) / span, 0.0, 1.0);
  return middle + above * (limit - middle) - below * (limit + middle);
}

/// Returns the area that both boxes share. It is computed with Green's theorem along the edges of b
/// in the frame of a, as in pyinfra/core/boxes.py. The area is a sum over the edges of b. Each term
/// is the mean of x along the edge times the change of y along the edge, where x and y are clipped
/// to box a.
double overlap(const Footprint& a, const Footprint& b) {
  const double dx = b.x - a.x, dy = b.y - a.y;
  const double x0 = a.cos * dx + a.sin * dy, y0 = a.cos * dy - a.sin * dx;
  const double cos = std::cos(b.heading - a.heading), sin = std::sin(b.heading - a.heading);
  const std::array<double, 4> ahead{b.length / 2, b.length / 2, -b.length / 2, -b.length / 2};
  const std::array<double, 4> left{-b.width / 2, b.width / 2, b.width / 2, -b.width / 2};
  std::array<double, 4> x{}, y{};
  for (std::size_t k = 0; k < 4; ++k) {
    x[k] = x0 + cos * ahead[k] - sin * left[k];
    y[k] = y0 + sin * ahead[k] + cos * left[k];
  }
  double area = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    const std::size_t next = (k + 1) % 4;
    const double from_y = std::clamp(y[k], -a.width / 2, a.width / 2);
    const double to_y = std::clamp(y[next], -a.width / 2, a.width / 2);
    if (from_y == to_y) continue;
    const double x_step = x[next] - x[k], y_step = y[next] - y[k];
    const double enters = x[k] + (from_y - y[k]) / y_step * x_step;
    const double leaves = x[k] + (to_y - y[k]) / y_step * x_step;
    area += mean_clipped(enters, leaves, a.length / 2) * (to_y - from_y);
  }
  const double size = std::max({a.length, a.width, b.length, b.width});
  return area <= kRounding * size * size ? 0 : std::min({area, a.area(), b.area()});
}

bool suppresses(const Footprint& kept, const Footprint& other, double iou) {
  const double dx = kept.x - other.x, dy = kept.y - other.y, reach = kept.reach + other.reach;
  if (dx * dx + dy * dy > reach * reach) return false;
  const double shared = overlap(kept, other);
  const double whole = kept.area() + other.area() - shared;
  return (whole > 0 ? shared / whole : 0) > iou;
}

}  // namespace

std::vector<std::int64_t> suppress(std::span<const double> boxes, double iou, std::int64_t limit) {
  if (std::isnan(iou)) throw std::invalid_argument("iou: expected a number, got nan");
  if (limit < 0)
    throw std::invalid_argument("limit: expected 0 or more, got " + std::to_string(limit));
  if (!std::all_of(boxes.begin(), boxes.end(), [](double v) { return std::isfinite(v); }))
    throw std::invalid_argument("boxes: expected finite values, got NaN or inf");
  std::vector<std::int64_t> rows;
  std::vector<Footprint> kept;
  for (std::size_t i = 0; i < boxes.size() / 7; ++i) {
    if (static_cast<std::int64_t>(rows.size()) >= limit) break;
    const Footprint box(boxes.subspan(7 * i, 7));
    if (std::any_of(kept.begin(), kept.end(),
                    [&](const Footprint& other) { return suppresses(other, box, iou); }))
      continue;
    kept.push_back(box);
    rows.push_back(static_cast<std::int64_t>(i));
  }
  return rows;
}

}  // namespace pointops
