#pragma once

#include <string>

#include "infrasim/config/scene_config.h"
#include "infrasim/scene/curve.h"

namespace infrasim {

inline constexpr double kRingShoulder_m = 0.5;  ///< width of the shoulder outside a ring's lane
/// length of an approach, from its stop line to the ring
inline constexpr double kRingFlare_m = 10;

/// A roundabout with one lane, driven counter-clockwise.
struct Ring {
  std::string name;
  Vec2 centre;
  double elevation_m = 0;
  RoundaboutConfig config;

  /// Returns the closed centreline of the ring's lane. The line begins and ends on the side
  /// opposite to `near`.
  Curve line(Vec2 near) const;
  /// Returns the path from a stop line over the ring to an exit.
  Curve way(const CurvePoint& from, const CurvePoint& to) const;
  /// Returns the point at which vehicles from a stop line enter the ring.
  Vec2 entry(Vec2 stop) const;
  /// Returns the length along the ring in the direction of traffic, between the points of the ring
  /// that are nearest to two positions.
  double along(Vec2 from, Vec2 to) const;
  /// Returns whether a point is on the roundabout's lane or island.
  bool holds(Vec2 point) const {
    return norm(point - centre) < config.radius_m + config.width_m / 2;
  }
  /// Returns the distance from the ring's centre to the stop lines.
  double reach_m() const;
};

}  // namespace infrasim
