#include "infrasim/sensor/beam.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace infrasim {

namespace {

constexpr float kRangeResolution = 0.5F;  // m: echoes closer than a pulse of 3 ns merge
constexpr double kAlongUp = 1e-6;         // sine: nearer to up or down a side is rounding alone

/// Power of a sub-ray's echo, up to a constant.
float power(float range, float cos_incidence, float reflectance) {
  return reflectance * cos_incidence / (range * range);
}

}  // namespace

Beam::Beam(const BeamConfig& config, const Mat3& unit_pose)
    : vertical_(config.vertical_deg >= config.horizontal_deg),
      up_(unit_pose * Vec3{0, 0, 1}),
      left_(unit_pose * Vec3{0, 1, 0}) {
  const double width = rad(std::max(config.vertical_deg, config.horizontal_deg));
  for (int i = 0; i < config.sub_rays; ++i)
    offsets_.push_back(static_cast<float>(std::tan(width * ((i + 0.5) / config.sub_rays - 0.5))));
}

/// Unit vector along which the sub-rays of a ray lie; straight up and down any level one is right.
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

void Beam::combine(const HitBatch& sub_hits, const std::vector<float>& sub_reflectance,
                   std::span<const std::uint32_t> selected, const EchoPath& path, HitBatch& hits,
                   std::vector<float>& reflectance, std::vector<float>& sunlit) const {
  reflectance.resize(hits.size());
  sunlit.resize(hits.size());
  std::ranges::fill(hits.range, std::numeric_limits<float>::infinity());
  std::ranges::fill(hits.object, -1);
  const std::size_t n = offsets_.size();
  for (std::size_t k = 0; k < selected.size(); ++k) {
    const std::size_t i = selected[k], first = n * k;
    float strongest = 0, lit = 0;
    for (std::size_t a = first; a < first + n; ++a)
      if (std::isfinite(sub_hits.range[a])) lit += sub_reflectance[a];
    sunlit[i] = lit / static_cast<float>(n);
    for (std::size_t a = first; a < first + n; ++a) {
      if (!std::isfinite(sub_hits.range[a])) continue;
      const Echo echo = echo_around(a, first, sub_hits, sub_reflectance);
      const float range = echo.weighted_range / echo.power;
      const float received = path.share(range) * echo.power;
      if (received > strongest) {
        strongest = received;
        hits.range[i] = range;
        hits.object[i] = sub_hits.object[echo.owner];
        hits.class_id[i] = sub_hits.class_id[echo.owner];
        hits.cos_incidence[i] = 1;
        reflectance[i] = echo.reflected / static_cast<float>(n);
      }
      if (echo.holds_all) break;  // the others' sums are this one
    }
  }
}

/// The sum of the sub-rays' echoes within the range resolution of one of them.
Beam::Echo Beam::echo_around(std::size_t a, std::size_t first, const HitBatch& sub_hits,
                             const std::vector<float>& sub_reflectance) const {
  Echo echo;
  echo.owner = a;
  float best = 0, nearest = sub_hits.range[a], farthest = nearest;
  for (std::size_t b = first; b < first + offsets_.size(); ++b) {
    const float range = sub_hits.range[b];
    if (!std::isfinite(range)) continue;
    nearest = std::min(nearest, range);
    farthest = std::max(farthest, range);
    if (!(std::abs(range - sub_hits.range[a]) <= kRangeResolution)) continue;
    const float p = power(range, sub_hits.cos_incidence[b], sub_reflectance[b]);
    echo.power += p;
    echo.weighted_range += p * range;
    echo.reflected += sub_reflectance[b] * sub_hits.cos_incidence[b];
    if (p > best) best = p, echo.owner = b;
  }
  echo.holds_all = farthest - nearest <= kRangeResolution;
  return echo;
}

}  // namespace infrasim
