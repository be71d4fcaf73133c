#include "infrasim/scene/curve.h"

#include <algorithm>
#include <array>
#include <utility>

#include "infrasim/core/math.h"

namespace infrasim {

namespace {

// m, maximum length of the pieces into which a segment is cut for the grid; the bounding boxes of
// longer pieces would touch many squares
constexpr double kGridPiece_m = 16;

/// Returns the part of a segment, as shares from 0 to 1, whose coordinate lies between two limits.
/// The part is empty if the first share is above the second one.
std::pair<double, double> part_between(double from, double to, double low, double high) {
  const double step = to - from;
  if (step == 0) return from < low || from > high ? std::pair{1.0, 0.0} : std::pair{0.0, 1.0};
  const auto [a, b] = std::minmax({(low - from) / step, (high - from) / step});
  return {std::max(a, 0.0), std::min(b, 1.0)};
}

}  // namespace

Curve::Curve(std::vector<CurvePoint> samples) : samples_(std::move(samples)) {
  s_.reserve(samples_.size());
  for (std::size_t i = 0; i < samples_.size(); ++i)
    s_.push_back(i == 0 ? 0 : s_.back() + norm(samples_[i].position - samples_[i - 1].position));
}

std::size_t Curve::segment_at(double s) const {
  const auto after = std::upper_bound(s_.begin() + 1, s_.end() - 1, s);
  return static_cast<std::size_t>(after - s_.begin()) - 1;
}

CurvePoint Curve::at(double s) const {
  const std::size_t i = segment_at(s);
  const double span = s_[i + 1] - s_[i];
  const double u = span > 0 ? std::clamp((s - s_[i]) / span, 0.0, 1.0) : 0;
  const CurvePoint &a = samples_[i], &b = samples_[i + 1];
  return {a.position + u * (b.position - a.position),
          a.heading + u * wrap_angle(b.heading - a.heading)};
}

Curve::SegmentPoint Curve::nearest_on(std::size_t segment, Vec2 point) const {
  const Vec2 a = samples_[segment].position;
  const Vec2 edge = samples_[segment + 1].position - a;
  const double u = std::clamp(dot(point - a, edge) / dot(edge, edge), 0.0, 1.0);
  return {norm(point - (a + u * edge)), s_[segment] + u * (s_[segment + 1] - s_[segment])};
}

double Curve::project(Vec2 point) const {
  SegmentPoint best{kInf, 0};
  for (std::size_t i = 0; i + 1 < samples_.size(); ++i)
    if (const SegmentPoint here = nearest_on(i, point); here.away < best.away) best = here;
  return best.station;
}

Curve Curve::part(double s0, double s1) const {
  std::vector<CurvePoint> samples{at(s0)};
  for (std::size_t i = 0; i < samples_.size(); ++i)
    if (s_[i] > s0 + 1e-6 && s_[i] < s1 - 1e-6) samples.push_back(samples_[i]);
  samples.push_back(at(s1));
  return Curve(std::move(samples));
}

Curve Curve::offset(double left_m) const {
  std::vector<CurvePoint> samples = samples_;
  for (CurvePoint& p : samples)
    p.position = p.position + left_m * heading_vector(p.heading + kPi / 2);
  return Curve(std::move(samples));
}

Curve Curve::reversed() const {
  std::vector<CurvePoint> samples(samples_.rbegin(), samples_.rend());
  for (CurvePoint& p : samples) p.heading = wrap_angle(p.heading + kPi);
  return Curve(std::move(samples));
}

double Curve::tightest_radius() const {
  double radius = kInf;
  for (std::size_t i = 0; i + 1 < samples_.size(); ++i) {
    const double turned = std::abs(wrap_angle(samples_[i + 1].heading - samples_[i].heading));
    if (turned > 1e-9) radius = std::min(radius, (s_[i + 1] - s_[i]) / turned);
  }
  return radius;
}

CurveGrid::CurveGrid(const Curve& curve, Vec2 low, Vec2 high, double reach_m)
    : low_(low), high_(high), reach_m_(reach_m) {
  const double beside = reach_m + 1;
  for (std::size_t i = 0; i + 1 < curve.samples().size(); ++i) {
    const Vec2 a = curve.samples()[i].position, b = curve.samples()[i + 1].position;
    const auto [x0, x1] = part_between(a.x, b.x, low.x - beside, high.x + beside);
    const auto [y0, y1] = part_between(a.y, b.y, low.y - beside, high.y + beside);
    const double from = std::max(x0, y0), to = std::min(x1, y1);
    if (from > to) continue;
    const auto pieces =
        std::max(1, static_cast<int>(std::ceil((to - from) * norm(b - a) / kGridPiece_m)));
    for (int k = 0; k < pieces; ++k) {
      const auto at = [&](int n) { return a + (from + (to - from) * n / pieces) * (b - a); };
      segments_.add(std::array{at(k), at(k + 1)}, i);
    }
  }
}

std::optional<double> CurveGrid::project(const Curve& curve, Vec2 point) const {
  if (point.x < low_.x || point.x > high_.x || point.y < low_.y || point.y > high_.y)
    return std::nullopt;
  // The margin is 1 cm larger than the reach, so that rounding errors do not lose a segment.
  const Vec2 beside{reach_m_ + 0.01, reach_m_ + 0.01};
  Curve::SegmentPoint best{kInf, 0};
  std::size_t best_segment = 0;
  segments_.any_near(std::array{point - beside, point + beside}, [&](std::size_t i) {
    const Curve::SegmentPoint here = curve.nearest_on(i, point);
    // If several segments are equally near, the first one is used, as in Curve::project.
    if (here.away < best.away || (here.away == best.away && i < best_segment)) {
      best = here;
      best_segment = i;
    }
    return false;
  });
  return best.away <= reach_m_ ? std::optional(best.station) : std::nullopt;
}

Curve turn(const CurvePoint& from, const CurvePoint& to) {
  // With handles of 0.39 times the chord, the Bezier curve of a quarter turn deviates from a circle
  // by at most 0.04 % of the radius.
  constexpr int kSteps = 40;
  const double handle = 0.39 * norm(to.position - from.position);
  const Vec2 p1 = from.position + handle * heading_vector(from.heading);
  const Vec2 p2 = to.position - handle * heading_vector(to.heading);
  std::vector<CurvePoint> samples;
  for (int i = 0; i <= kSteps; ++i) {
    const double u = static_cast<double>(i) / kSteps, v = 1 - u;
    const Vec2 position = v * v * v * from.position + 3 * u * v * v * p1 + 3 * u * u * v * p2 +
                          u * u * u * to.position;
    const Vec2 slope =
        v * v * (p1 - from.position) + 2 * u * v * (p2 - p1) + u * u * (to.position - p2);
    samples.push_back({position, math::atan2(slope.y, slope.x)});
  }
  return Curve(std::move(samples));
}

}  // namespace infrasim
