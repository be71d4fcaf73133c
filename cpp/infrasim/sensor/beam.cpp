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

void Beam::expand(const RayBatch& rays, RayBatch& sub_rays) const {
  const std::size_t n = offsets_.size();
  sub_rays.resize(n * rays.size());
  sub_rays.max_range = rays.max_range;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const Vec3 d{rays.dx[i], rays.dy[i], rays.dz[i]};
    const Vec3 side = side_of(d);
    for (std::size_t j = 0; j < n; ++j) {
      const Vec3 tilted = d + static_cast<double>(offsets_[j]) * side;
      const Vec3 sub = 1 / norm(tilted) * tilted;
      const std::size_t k = n * i + j;
      sub_rays.dx[k] = static_cast<float>(sub.x);
      sub_rays.dy[k] = static_cast<float>(sub.y);
      sub_rays.dz[k] = static_cast<float>(sub.z);
      sub_rays.time[k] = rays.time[i];
    }
  }
}

void Beam::combine(const HitBatch& sub_hits, const std::vector<float>& sub_reflectance,
                   HitBatch& hits, std::vector<float>& reflectance) const {
  const std::size_t n = offsets_.size();
  hits.resize(sub_hits.size() / n);
  reflectance.resize(hits.size());
  for (std::size_t i = 0; i < hits.size(); ++i) {
    hits.range[i] = std::numeric_limits<float>::infinity();
    hits.object[i] = -1;
    float strongest = 0;
    for (std::size_t a = n * i; a < n * (i + 1); ++a) {
      if (!std::isfinite(sub_hits.range[a])) continue;
      float sum = 0, weighted_range = 0, reflected = 0, best = 0;
      std::size_t owner = a;
      for (std::size_t b = n * i; b < n * (i + 1); ++b) {
        if (!(std::abs(sub_hits.range[b] - sub_hits.range[a]) <= kRangeResolution)) continue;
        const float p = power(sub_hits.range[b], sub_hits.cos_incidence[b], sub_reflectance[b]);
        sum += p;
        weighted_range += p * sub_hits.range[b];
        reflected += sub_reflectance[b] * sub_hits.cos_incidence[b];
        if (p > best) best = p, owner = b;
      }
      if (sum <= strongest) continue;
      strongest = sum;
      hits.range[i] = weighted_range / sum;
      hits.object[i] = sub_hits.object[owner];
      hits.class_id[i] = sub_hits.class_id[owner];
      hits.cos_incidence[i] = 1;
      reflectance[i] = reflected / static_cast<float>(n);
    }
  }
}

}  // namespace infrasim
