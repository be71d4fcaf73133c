#pragma once

#include <cmath>

#include "infrasim/core/math.h"

namespace infrasim {

/// Attenuation between the LiDAR and an echo, without the decrease with the square of the range.
struct EchoPath {
  float min_range_m = 0;        ///< end of the blind zone; nearer echoes do not count
  double extinction_per_m = 0;  ///< extinction of the air

  /// The share of an echo's power that is received.
  float share(float range_m) const {
    if (range_m < min_range_m) return 0;
    return extinction_per_m > 0 ? static_cast<float>(math::exp(-2 * extinction_per_m * range_m))
                                : 1;
  }
};

}  // namespace infrasim
