#pragma once

#include <optional>
#include <string>
#include <vector>

#include "infrasim/config/tree.h"
#include "infrasim/core/geometry.h"

// Roads, their profile, the ground beside them, and junctions in the scene file.

namespace infrasim {

/// A piece of a road's centreline: a straight line or an arc. An arc with a positive angle turns
/// left.
struct CentrelinePiece {
  double line_m = 0;
  double radius_m = 0;
  double turn_deg = 0;
};

struct RoadStart {
  double x_m = 0;
  double y_m = 0;
  double heading_deg = 0;
};

/// Cross-section of a road. A two-way road has the same number of lanes on both sides of the
/// centreline, with traffic on the right. On a one-way road the centreline is in the middle of all
/// lanes.
struct LanesConfig {
  int each_way = 1;
  std::optional<bool> one_way;
  double width_m = 3.5;
  double median_m = 0;
  double shoulder_m = 0;
  double sidewalk_m = 0;
};

inline bool is_one_way(const LanesConfig& lanes) { return lanes.one_way.value_or(false); }

/// Returns the distance from the centreline to the outer edge of the lanes.
inline double lanes_half_width(const LanesConfig& lanes) {
  const double one_side = lanes.each_way * lanes.width_m;
  return is_one_way(lanes) ? one_side / 2 : lanes.median_m / 2 + one_side;
}

struct EmbankmentConfig {
  double run_per_rise = 1.5;
  double foot_elevation_m = -8;
};

struct RoadConfig {
  std::string name;
  RoadStart start;
  std::vector<CentrelinePiece> centreline;
  double elevation_m = 0;
  LanesConfig lanes;
  std::optional<EmbankmentConfig> embankment;
  config::Place place;
};

/// The elevation profile of the scene along one direction. All other keys describe a level scene.
/// The profile then raises each point by the rise at its position.
struct ProfileConfig {
  double x_m = 0;
  double y_m = 0;
  double heading_deg = 0;
  /// stations along heading_deg from the point (x_m, y_m), and the rise at each station, in metres
  std::vector<Vec2> points_m;
  double vertical_curve_m = 40;
};

/// A level piece of terrain with a convex outline. Where a scene has no terrain, rays towards the
/// ground have no return.
struct GroundConfig {
  double elevation_m = 0;
  std::vector<Vec2> outline_m;
  config::Place place;
};

struct SignalConfig {
  double green_s = 14;
  double all_red_s = 2;
};

/// A ring of one lane around an island.
struct RoundaboutConfig {
  double radius_m = 15;
  double width_m = 6;
  double island_m = 0.3;
};

/// A crossing of two roads. It has signals with a green phase for each approach, or it is a
/// roundabout without signals.
struct JunctionConfig {
  std::vector<std::string> roads;
  /// signal timing; if missing, the default timing is used; not allowed together with `roundabout`
  std::optional<SignalConfig> signal;
  std::optional<RoundaboutConfig> roundabout;
  double left_share = 0.2;
  double right_share = 0.2;
  config::Place place;
};

}  // namespace infrasim
