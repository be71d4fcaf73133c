#include "infrasim/scene/roundabout.h"

#include "infrasim/core/math.h"

namespace infrasim {

namespace {

constexpr double kFlareAngle =
    kPi * 25 / 180;  // angle on the ring between an arm's lane and its entry or exit of the ring

double polar(Vec2 centre, Vec2 point) {
  return math::atan2(point.y - centre.y, point.x - centre.x);
}

CurvePoint on_ring(const Ring& ring, double angle) {
  return {ring.centre + ring.config.radius_m * heading_vector(angle), wrap_angle(angle + kPi / 2)};
}

/// Returns the arc from `start` counter-clockwise by `sweep`, both ends included.
std::vector<CurvePoint> arc(const Ring& ring, double start, double sweep) {
  const auto steps = static_cast<int>(std::ceil(sweep * ring.config.radius_m / 0.5));
  std::vector<CurvePoint> out;
  for (int i = 0; i <= steps; ++i) out.push_back(on_ring(ring, start + sweep * i / steps));
  return out;
}

}  // namespace

Curve Ring::line(Vec2 near) const { return Curve(arc(*this, polar(centre, near) + kPi, 2 * kPi)); }

Curve Ring::way(const CurvePoint& from, const CurvePoint& to) const {
  const double enter = polar(centre, from.position) + kFlareAngle;
  const double leave = polar(centre, to.position) - kFlareAngle;
  const double sweep = std::fmod(leave - enter + 4 * kPi, 2 * kPi);
  std::vector<CurvePoint> samples = turn(from, on_ring(*this, enter)).samples();
  for (const std::vector<CurvePoint>& more :
       {arc(*this, enter, sweep), turn(on_ring(*this, leave), to).samples()})
    samples.insert(samples.end(), more.begin() + 1, more.end());
  return Curve(std::move(samples));
}

Vec2 Ring::entry(Vec2 stop) const {
  return on_ring(*this, polar(centre, stop) + kFlareAngle).position;
}

double Ring::along(Vec2 from, Vec2 to) const {
  return config.radius_m * std::fmod(polar(centre, to) - polar(centre, from) + 4 * kPi, 2 * kPi);
}

double Ring::reach_m() const { return config.radius_m + config.width_m / 2 + kRingFlare_m; }

}  // namespace infrasim
