#include "infrasim/scene/curve.h"

#include <algorithm>

#include "infrasim/core/math.h"

namespace infrasim {

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

double Curve::project(Vec2 point) const {
  double best = kInf;
  double station = 0;
  for (std::size_t i = 0; i + 1 < samples_.size(); ++i) {
    const Vec2 a = samples_[i].position;
    const Vec2 edge = samples_[i + 1].position - a;
    const double u = std::clamp(dot(point - a, edge) / dot(edge, edge), 0.0, 1.0);
    const double distance = norm(point - (a + u * edge));
    if (distance < best) {
      best = distance;
      station = s_[i] + u * (s_[i + 1] - s_[i]);
    }
  }
  return station;
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

Curve turn(const CurvePoint& from, const CurvePoint& to) {
  // If a handle is 0.39 times the chord, a quarter turn deviates from a circle by at most 0.03 % of
  // the radius.
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
