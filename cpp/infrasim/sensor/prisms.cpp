#include "infrasim/sensor/prisms.h"

#include <algorithm>
#include <cmath>

#include "infrasim/core/errors.h"
#include "infrasim/core/geometry.h"
#include "infrasim/core/math.h"

namespace infrasim {

namespace {

/// Applies Snell's law in vector form at a face with the given normal. `mu` is the refractive index
/// before the face divided by the index behind it. Totally reflected directions become NaN.
void refract(Vec3 normal, double mu, DirectionBatch& directions) {
  for (std::size_t i = 0; i < directions.x.size(); ++i) {
    const double c =
        directions.x[i] * normal.x + directions.y[i] * normal.y + directions.z[i] * normal.z;
    const double turn = std::sqrt(1 - mu * mu * (1 - c * c)) - mu * c;
    directions.x[i] = mu * directions.x[i] + turn * normal.x;
    directions.y[i] = mu * directions.y[i] + turn * normal.y;
    directions.z[i] = mu * directions.z[i] + turn * normal.z;
  }
}

/// Applies Snell's law at a face perpendicular to x.
void refract_flat(double mu, DirectionBatch& directions) {
  for (std::size_t i = 0; i < directions.x.size(); ++i) {
    directions.x[i] = std::sqrt(1 - mu * mu * (1 - directions.x[i] * directions.x[i]));
    directions.y[i] *= mu;
    directions.z[i] *= mu;
  }
}

/// Computes the directions behind one prism. `tilted` is the normal of the prism's tilted face.
void pass(const PrismConfig& prism, Vec3 tilted, DirectionBatch& directions) {
  const double n = prism.refractive_index;
  if (prism.faces == Faces::kTiltedFirst) {
    refract(tilted, 1 / n, directions);
    refract_flat(n, directions);
  } else {
    refract_flat(1 / n, directions);
    refract(tilted, n, directions);
  }
}

/// @throws ConfigError for total reflection
void check_transmitted(const DirectionBatch& directions) {
  if (std::ranges::any_of(directions.x, [](double x) { return std::isnan(x); }))
    throw ConfigError(
        "pattern.prisms.prisms: expected smaller angle_deg, refractive_index or "
        "laser_offsets, got a ray with total reflection in a prism");
}

}  // namespace

void trace(const std::vector<PrismConfig>& prisms,
           const std::vector<std::pair<double, double>>& tilts, const DirectionBatch& lasers,
           double time_s, DirectionBatch& directions) {
  directions = lasers;
  for (std::size_t i = 0; i < prisms.size(); ++i) {
    const PrismConfig& prism = prisms[i];
    const auto [ca, sa] = tilts[i];
    const auto [c, s] =
        math::cos_sin(2 * kPi * std::fmod(prism.rpm / 60 * time_s, 1.0) + rad(prism.phase_deg));
    pass(prism, {ca, sa * c, sa * s}, directions);
  }
  check_transmitted(directions);
}

}  // namespace infrasim
