#pragma once

#include <cmath>
#include <cstdint>
#include <span>

#include "infrasim/core/math.h"

namespace infrasim {

/// Attenuation between the LiDAR and an echo, without the decrease with the square of the range.
struct EchoPath {
  float min_range_m = 0;        ///< end of the blind zone; nearer echoes do not count
  double extinction_per_m = 0;  ///< extinction of the air
  /// end of the blind zone of each ring, from ring `first_ring` up; if empty, all rings have
  /// `min_range_m`
  std::span<const float> min_range_by_ring_m = {};  // NOLINT(readability-redundant-member-init)
  int first_ring = 0;

  /// Returns the range at which the blind zone of a ring ends, in metres.
  float blind_m(std::uint16_t ring) const {
    return min_range_by_ring_m.empty()
               ? min_range_m
               : min_range_by_ring_m[static_cast<std::size_t>(ring - first_ring)];
  }
  /// Returns the share of an echo's power that is received; 0 in the blind zone.
  float share(float range_m, std::uint16_t ring) const {
    if (range_m < blind_m(ring)) return 0;
    return extinction_per_m > 0 ? static_cast<float>(math::exp(-2 * extinction_per_m * range_m))
                                : 1;
  }
};

}  // namespace infrasim
