#pragma once

#include "infrasim/core/classes.h"
#include "infrasim/core/rng.h"

namespace infrasim {

/// Returns the diffuse reflectance of a background material near 905 nm. The value of asphalt lies
/// between dark asphalt (0.15) and old, light asphalt (0.28). Grass has 0.51, deciduous leaves have
/// 0.55, and concrete has 0.3 to 0.4. The values are nominal.
constexpr float background_reflectance(Class material) {
  switch (material) {
    case Class::kRoad:
      return 0.20F;
    case Class::kTerrain:
      return 0.51F;
    case Class::kVegetation:
      return 0.55F;
    case Class::kRecorded:
      return 1;  // the recorded intensity is used as the gain
    default:
      return 0.35F;
  }
}

/// Returns a random reflectance of a vehicle's paint, which is white, silver, coloured or black.
/// The shares and values are nominal.
inline float paint_reflectance(const Rng& vehicle) {
  struct Paint {
    double share, low, high;
  };
  constexpr Paint kPaints[] = {{.35, .60, .80}, {.25, .35, .45}, {.20, .15, .35}, {.20, .03, .10}};
  double u = vehicle.uniform(0);
  for (const Paint& p : kPaints) {
    if (u < p.share) return static_cast<float>(p.low + (p.high - p.low) * vehicle.uniform(1));
    u -= p.share;
  }
  return 0.2F;
}

}  // namespace infrasim
