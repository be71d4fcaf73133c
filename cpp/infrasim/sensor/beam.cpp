#include "infrasim/sensor/beam.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "infrasim/core/math.h"

namespace infrasim {

namespace {

// minimum sine of the angle between a ray and the unit's z axis; for smaller angles, rounding
// errors would determine the directions left and up
constexpr double kAlongUp = 1e-6;
constexpr int kSubRaysOfRing = 6;  // number of sub-rays in ring 1; ring k has k times as many
// If the outermost sub-rays are closer than this to the middle ray, one ray replaces the beam.
constexpr float kLeastRadius_m = 0.02F;
// Limit of the ratio of a beam's axes. Above it, the probes on the ring are the sub-rays at the two
// ends of the longer axis. Otherwise, the probes are every second sub-ray of the ring.
constexpr double kLong = 3;

}  // namespace

Beam::Beam(const std::optional<BeamConfig>& config, const Mat3& unit_pose)
    : places_{{0, 0}},
      shares_{1},
      probe_shares_{1},
      up_(unit_pose * Vec3{0, 0, 1}),
      left_(unit_pose * Vec3{0, 1, 0}) {
  if (!config) return;
  everywhere_ = config->where == BeamWhere::kEverywhere;
  const int rings = config->sub_rays / 2;
  const auto [narrow, wide] = std::minmax(config->horizontal_deg, config->vertical_deg);
  // number of probes besides the middle sub-ray
  const int probes = wide > kLong * narrow ? 2 : kSubRaysOfRing / 2;
  // area of the beam divided by the area of the middle sub-ray's part
  const double parts = (2.0 * rings + 1) * (2 * rings + 1);
  const double left = math::tan(rad(config->horizontal_deg / 2));
  const double up = math::tan(rad(config->vertical_deg / 2));
  shares_[0] = static_cast<float>(1 / parts);
  for (int ring = 1; ring <= rings; ++ring) {
    const int n = kSubRaysOfRing * ring;
    // The radius is the root mean square of the radii in the ring, from 2 ring - 1 to 2 ring + 1,
    // relative to the radius of the beam.
    const double radius = std::sqrt((4.0 * ring * ring + 1) / parts);
    for (int i = 0; i < n; ++i) {
      // The first sub-ray is on the longer axis of the ellipse. If the beam has one ring, its first
      // sub-rays are the probes.
      const int place = rings == 1 ? n / probes * (i % probes) + i / probes : i;
      const auto [along, across] = math::cos_sin(2 * kPi * place / n);
      places_.push_back(up > left ? Vec2{radius * left * across, radius * up * along}
                                  : Vec2{radius * left * along, radius * up * across});
      shares_.push_back(static_cast<float>(8.0 * ring / n / parts));
    }
    half_width_ = static_cast<float>(radius * std::max(left, up));
    from_m_ = half_width_ > 0 ? kLeastRadius_m / half_width_ : std::numeric_limits<float>::max();
  }
  probe_shares_ = shares_;
  if (rings > 1) return;
  // With these shares, the mean square distance of the probes from each axis equals that of the
  // ellipse: a quarter of the squared half-axis. With two probes, this is true only along the
  // longer axis.
  const double on_ring = (probes == 2 ? 0.25 : 0.5) / ((4 + 1) / parts);
  probe_shares_.assign(1 + static_cast<std::size_t>(probes), static_cast<float>(on_ring / probes));
  probe_shares_[0] = static_cast<float>(1 - on_ring);
}

/// Returns two unit vectors perpendicular to a ray: to its left and upwards. For a ray along the
/// unit's z axis, left is the unit's y axis.
std::array<Vec3, 2> Beam::axes_of(Vec3 ray) const {
  const Vec3 across = cross(up_, ray);
  const double sine = norm(across);
  const Vec3 left = sine < kAlongUp ? left_ : 1 / sine * across;
  return {left, cross(ray, left)};
}

void Beam::expand(const RayBatch& rays, std::span<const std::uint32_t> selected, std::size_t from,
                  std::size_t to, RayBatch& sub_rays) const {
  std::size_t k = sub_rays.size();
  sub_rays.resize(k + (to - from) * selected.size());
  sub_rays.max_range = rays.max_range;
  for (const std::uint32_t i : selected) {
    const Vec3 d{rays.dx[i], rays.dy[i], rays.dz[i]};
    const auto [left, up] = axes_of(d);
    for (std::size_t j = from; j < to; ++j, ++k) {
      sub_rays.time[k] = rays.time[i];
      sub_rays.ring[k] = rays.ring[i];
      sub_rays.dx[k] = rays.dx[i];
      sub_rays.dy[k] = rays.dy[i];
      sub_rays.dz[k] = rays.dz[i];
      if (j == 0) continue;
      const Vec3 tilted = d + places_[j].x * left + places_[j].y * up;
      const Vec3 sub = 1 / norm(tilted) * tilted;
      sub_rays.dx[k] = static_cast<float>(sub.x);
      sub_rays.dy[k] = static_cast<float>(sub.y);
      sub_rays.dz[k] = static_cast<float>(sub.z);
    }
  }
}

}  // namespace infrasim
