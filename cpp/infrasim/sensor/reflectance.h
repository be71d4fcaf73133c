#pragma once

#include "infrasim/core/classes.h"
#include "infrasim/core/rng.h"

namespace infrasim {

/// Diffuse reflectance of the background near 905 nm. Asphalt lies between old and light (0.28) and
/// dark (0.15). Grass has 0.51, deciduous leaves 0.55, concrete 0.3 to 0.4 (nominal).
constexpr float background_reflectance(Class material) {
  switch (material) {
    case Class::kRoad:
      return 0.20F;
    case Class::kTerrain:
      return 0.51F;
    case Class::kVegetation:
      return 0.55F;
    case Class::kRecorded:
      return 1;  // its intensity replaces the cosine
    default:
      return 0.35F;
  }
}

/// Reflectance of a vehicle's paint: white, silver, coloured or black (nominal shares and values).
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
