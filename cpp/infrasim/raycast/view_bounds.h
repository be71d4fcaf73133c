#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

namespace infrasim {

/// Stands in for the azimuth of a direction at the cost of a division: grows with it from -2 at
/// -180 degrees to 2 at 180. 0 straight up and down.
inline float bearing(float dx, float dy) {
  const float sum = std::abs(dx) + std::abs(dy);
  return sum > 0 ? std::copysign(1 - dx / sum, dy) : 0.0F;
}

/// What some directions span, seen from the origin: a rectangle of bearing and of the sine of
/// elevation. Directions on both sides of 180 degrees span all bearings.
struct ViewBounds {
  float left = std::numeric_limits<float>::infinity();  ///< lowest bearing
  float right = -std::numeric_limits<float>::infinity();
  float low = std::numeric_limits<float>::infinity();  ///< lowest sine of elevation
  float high = -std::numeric_limits<float>::infinity();

  void add(float dx, float dy, float dz) {
    const float b = bearing(dx, dy);
    left = std::min(left, b);
    right = std::max(right, b);
    low = std::min(low, dz);
    high = std::max(high, dz);
  }
  bool meets(const ViewBounds& o) const {
    return left <= o.right && o.left <= right && low <= o.high && o.low <= high;
  }
};

}  // namespace infrasim
