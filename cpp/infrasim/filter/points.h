#pragma once

#include <cassert>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

#include "infrasim/core/geometry.h"

namespace infrasim {

inline std::size_t point_count(std::span<const float> xyz) {
  assert(xyz.size() % 3 == 0);
  return xyz.size() / 3;
}

inline Vec3 point_at(std::span<const float> xyz, std::size_t i) {
  return {xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]};
}

/// Returns whether a point is a return. Drivers write 0 0 0 or NaN for a ray without a return.
inline bool is_return(Vec3 p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z) &&
         (p.x != 0 || p.y != 0 || p.z != 0);
}

/// Returns the indices of the returns for which `wanted(Vec3)` holds, in increasing order.
template <class Predicate>
std::vector<int> keep_if(std::span<const float> xyz, Predicate wanted) {
  std::vector<int> kept;
  for (std::size_t i = 0; i < point_count(xyz); ++i) {
    const Vec3 p = point_at(xyz, i);
    if (is_return(p) && wanted(p)) kept.push_back(static_cast<int>(i));
  }
  return kept;
}

}  // namespace infrasim
