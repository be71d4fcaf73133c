#include "infrasim/raycast/view_bounds.h"

#include "infrasim/core/math.h"

namespace infrasim {

namespace {

constexpr float kMargin =
    1e-5F;  // margin of bearing and sine, larger than the rounding errors of float
// twice the margin, because a bearing changes at least half as much as the angle
constexpr double kAngleMargin = 2 * kMargin;

/// Returns the horizontal distance from the origin to a convex outline; 0 if the origin is inside
/// the outline.
double nearest(std::span<const Vec2> outline) {
  double distance = kInf;
  bool left = false, right = false;  // whether the origin is left or right of an edge
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const Vec2 a = outline[i], ab = outline[(i + 1) % outline.size()] - a;
    const double length_squared = dot(ab, ab), side = cross(a, ab);
    const double u = length_squared > 0 ? std::clamp(-dot(a, ab) / length_squared, 0.0, 1.0) : 0;
    distance = std::min(distance, norm(a + u * ab));
    (side > 0 ? left : right) = true;
  }
  return left != right ? 0 : distance;
}

double sine(double z, double distance) { return z == 0 ? 0 : z / math::hypot(z, distance); }

float bearing_of(double azimuth) {
  return bearing(static_cast<float>(math::cos(azimuth)), static_cast<float>(math::sin(azimuth)));
}

}  // namespace

std::array<ViewBounds, 2> view_of(std::span<const Vec2> outline, double bottom, double top) {
  const double near = nearest(outline), start = math::atan2(outline[0].y, outline[0].x);
  double from = start, to = start, far = 0;
  for (const Vec2& corner : outline) {
    const double azimuth = start + wrap_angle(math::atan2(corner.y, corner.x) - start);
    from = std::min(from, azimuth);
    to = std::max(to, azimuth);
    far = std::max(far, norm(corner));
  }
  ViewBounds view;
  view.low = static_cast<float>(sine(bottom, bottom < 0 ? near : far)) - kMargin;
  view.high = static_cast<float>(sine(top, top > 0 ? near : far)) + kMargin;
  view.left = -2;
  view.right = 2;
  if (near == 0) return {view, {}};  // the sensor is inside the outline
  // The margin is added before the split, so that an outline that ends at 180 degrees also has a
  // part at -180 degrees.
  from -= kAngleMargin;
  to += kAngleMargin;
  const bool behind = from < -kPi || to > kPi;
  ViewBounds other = behind ? view : ViewBounds{};
  view.left = bearing_of(behind ? wrap_angle(from) : from);
  (behind ? other : view).right = bearing_of(behind ? wrap_angle(to) : to);
  return {view, other};
}

void Horizon::add(const ViewBounds& view) {
  if (view.empty() || view.high <= 0) return;
  highest_ = std::max(highest_, view.high);
  for (std::size_t b = bin(view.left); b <= bin(view.right); ++b)
    sines_[b] = std::max(sines_[b], view.high);
}

/// Returns the horizon's highest sine of elevation over the azimuths that a cone spans.
float Horizon::highest_around(float dx, float dy, float spread) const {
  // The steeper a cone is, the more azimuths it spans. A bearing changes no faster than an azimuth.
  const float half = math::asin(std::min(1.0F, spread / math::hypot(dx, dy))) + kMargin;
  constexpr float kBinsPerUnit = kBins / 4.0F;
  const float middle = bearing(dx, dy) + 2;
  const auto first = static_cast<int>(std::floor((middle - half) * kBinsPerUnit));
  const auto last = static_cast<int>(std::floor((middle + half) * kBinsPerUnit));
  float highest = 0;
  for (int b = first; b <= last; ++b)
    highest = std::max(highest, sines_[static_cast<std::size_t>(b + int{kBins}) % kBins]);
  return highest;
}

}  // namespace infrasim
