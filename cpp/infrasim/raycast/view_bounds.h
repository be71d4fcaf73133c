#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>

#include "infrasim/core/geometry.h"

namespace infrasim {

/// Returns the bearing of a direction, which is a monotonic function of the azimuth and is faster
/// to compute. It increases from -2 at -180 degrees to 2 at 180 degrees. It is 0 for a vertical
/// direction.
inline float bearing(float dx, float dy) {
  const float sum = std::abs(dx) + std::abs(dy);
  return sum > 0 ? std::copysign(1 - dx / sum, dy) : 0.0F;
}

/// Returns the index of the bin of a bearing; all bins have the same width.
inline std::size_t bearing_bin(float bearing, std::size_t bins) {
  const auto n = static_cast<float>(bins);
  return static_cast<std::size_t>(std::clamp((bearing + 2) * (n / 4), 0.0F, n - 1));
}

/// Bounds of directions from the origin: a rectangle of bearing and sine of elevation. If
/// directions lie on both sides of 180 degrees, the rectangle spans all bearings.
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
  /// Adds all directions of a cone.
  /// @param spread tangent of half the cone's angle
  void add_cone(float dx, float dy, float dz, float spread) {
    if (!(spread > 0)) return add(dx, dy, dz);
    // The bearing changes no faster than the azimuth, and the sine no faster than the angle.
    const float level = std::sqrt(std::max(0.0F, 1 - dz * dz)), turn = 1.2F * spread;
    const float aside = level > 2 * turn ? turn / (level - turn) : 4;
    const float b = bearing(dx, dy);
    const bool across = std::abs(b) + aside > 2;
    left = std::min(left, across ? -2 : b - aside);
    right = std::max(right, across ? 2 : b + aside);
    low = std::min(low, dz - turn);
    high = std::max(high, dz + turn);
  }
  bool meets(const ViewBounds& o) const {
    return left <= o.right && o.left <= right && low <= o.high && o.low <= high;
  }
  bool empty() const { return left > right; }
};

/// Returns the view of an upright prism, with a margin for rounding. The second part is empty
/// unless the prism lies across 180 degrees.
/// @param outline convex, in either direction
std::array<ViewBounds, 2> view_of(std::span<const Vec2> outline, double bottom, double top);

/// The highest sine of elevation of all objects in the scene, by bearing. It is 0 at bearings
/// without an object above the horizontal.
class Horizon {
 public:
  /// Raises the horizon to include the view.
  void add(const ViewBounds& view);
  /// Returns false if a cone around the direction lies above all objects.
  /// @param spread tangent of half the cone's angle, 0 to 0.25
  bool covers(float dx, float dy, float dz, float spread = 0) const {
    const float lowest = dz - spread;  // the sine of elevation changes no faster than the angle
    // Near the zenith, small angles can be large differences of bearing.
    if (dz > kSteep) return lowest <= highest_;
    return lowest <= 0 ||
           lowest <= (spread > 0 ? highest_around(dx, dy, spread) : sines_[bin(bearing(dx, dy))]);
  }

 private:
  static constexpr std::size_t kBins = 256;
  static constexpr float kSteep = 0.9F;
  static std::size_t bin(float bearing) { return bearing_bin(bearing, kBins); }
  float highest_around(float dx, float dy, float spread) const;
  std::array<float, kBins> sines_{};
  float highest_ = 0;
};

}  // namespace infrasim
