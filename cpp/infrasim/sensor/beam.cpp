#include "infrasim/sensor/beam.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "infrasim/core/math.h"

namespace infrasim {

namespace {

// m; echoes that are closer together merge, because a pulse is 3 ns long
constexpr float kRangeResolution = 0.5F;
// sine; for rays closer to the vertical, rounding errors determine the side direction
constexpr double kAlongUp = 1e-6;

}  // namespace

Beam::Beam(const BeamConfig& config, const Mat3& unit_pose)
    : vertical_(config.vertical_deg >= config.horizontal_deg),
      up_(unit_pose * Vec3{0, 0, 1}),
      left_(unit_pose * Vec3{0, 1, 0}) {
  const double width = rad(std::max(config.vertical_deg, config.horizontal_deg));
  for (int i = 0; i < config.sub_rays; ++i)
    offsets_.push_back(static_cast<float>(math::tan(width * ((i + 0.5) / config.sub_rays - 0.5))));
}

/// Returns the unit vector along which the sub-rays of a ray are offset. For vertical rays it is
/// any horizontal vector.
Vec3 Beam::side_of(Vec3 ray) const {
  const Vec3 across = vertical_ ? up_ - dot(up_, ray) * ray : cross(up_, ray);
  const double sine = norm(across);
  return sine < kAlongUp ? left_ : 1 / sine * across;
}

void Beam::expand(const RayBatch& rays, std::span<const std::uint32_t> selected,
                  RayBatch& sub_rays) const {
  const std::size_t n = offsets_.size();
  sub_rays.resize(n * selected.size());
  sub_rays.max_range = rays.max_range;
  std::size_t k = 0;
  for (const std::uint32_t i : selected) {
    const Vec3 d{rays.dx[i], rays.dy[i], rays.dz[i]};
    const Vec3 side = side_of(d);
    for (std::size_t j = 0; j < n; ++j, ++k) {
      const Vec3 tilted = d + static_cast<double>(offsets_[j]) * side;
      const Vec3 sub = 1 / norm(tilted) * tilted;
      sub_rays.dx[k] = static_cast<float>(sub.x);
      sub_rays.dy[k] = static_cast<float>(sub.y);
      sub_rays.dz[k] = static_cast<float>(sub.z);
      sub_rays.time[k] = rays.time[i];
    }
  }
}

void Beam::combine(const EchoBatch& sub_echoes, std::span<const std::uint32_t> selected,
                   const EchoPath& path, EchoBatch& echoes, std::vector<float>& sunlit) const {
  sunlit.resize(echoes.size());
  std::ranges::fill(echoes.range, std::numeric_limits<float>::infinity());
  std::ranges::fill(echoes.object, -1);
  const std::size_t n = offsets_.size();
  for (std::size_t k = 0; k < selected.size(); ++k) {
    const std::size_t i = selected[k], first = n * k;
    float strongest = 0, lit = 0;
    for (std::size_t a = first; a < first + n; ++a)
      if (std::isfinite(sub_echoes.range[a])) lit += sub_echoes.reflectance[a];
    sunlit[i] = lit / static_cast<float>(n);
    for (std::size_t a = first; a < first + n; ++a) {
      if (!std::isfinite(sub_echoes.range[a])) continue;
      const MergedEcho merged = echo_around(a, first, sub_echoes);
      const float range = merged.weighted_range / merged.power;
      const float received = path.share(range) * merged.power;
      if (received > strongest) {
        strongest = received;
        echoes.set(
            i, {range, sub_echoes.object[merged.strongest], sub_echoes.class_id[merged.strongest],
                merged.reflected / static_cast<float>(n), 1});
      }
      if (merged.holds_all) break;  // no other sum can be larger
    }
  }
}

/// The sum of the sub-rays' echoes within the range resolution of sub-ray `a`.
Beam::MergedEcho Beam::echo_around(std::size_t a, std::size_t first,
                                   const EchoBatch& sub_echoes) const {
  MergedEcho merged;
  merged.strongest = a;
  float best = 0, nearest = sub_echoes.range[a], farthest = nearest;
  for (std::size_t b = first; b < first + offsets_.size(); ++b) {
    const float range = sub_echoes.range[b];
    if (!std::isfinite(range)) continue;
    nearest = std::min(nearest, range);
    farthest = std::max(farthest, range);
    if (!(std::abs(range - sub_echoes.range[a]) <= kRangeResolution)) continue;
    const float reflected = sub_echoes.reflectance[b] * sub_echoes.gain[b];
    const float power = reflected / (range * range);
    merged.power += power;
    merged.weighted_range += power * range;
    merged.reflected += reflected;
    if (power > best) best = power, merged.strongest = b;
  }
  merged.holds_all = farthest - nearest <= kRangeResolution;
  return merged;
}

}  // namespace infrasim
