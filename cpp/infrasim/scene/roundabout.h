#pragma once

#include <string>

#include "infrasim/config/scene_config.h"
#include "infrasim/scene/curve.h"

namespace infrasim {

inline constexpr double kRingShoulder_m = 0.5;  ///< outside of the lane
inline constexpr double kRingFlare_m = 10;      ///< of an approach, from its stop line to the ring

/// A roundabout of one lane, driven counter-clockwise.
struct Ring {
  std::string name;
  Vec2 centre;
  double elevation_m = 0;
  RoundaboutConfig config;

  /// Middle of the lane, closed; it begins and ends on the far side of a point.
  Curve line(Vec2 near) const;
  /// From a stop line over the ring to a way out.
  Curve way(const CurvePoint& from, const CurvePoint& to) const;
  /// Where who comes from a stop line is on the ring.
  Vec2 entry(Vec2 stop) const;
  /// Metres on the ring from beside one point to beside another, with the traffic.
  double along(Vec2 from, Vec2 to) const;
  /// Whether a point is on the lane or the island.
  bool holds(Vec2 point) const {
    return norm(point - centre) < config.radius_m + config.width_m / 2;
  }
  /// From the centre to the stop lines.
  double reach_m() const;
};

}  // namespace infrasim
