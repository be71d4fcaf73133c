#pragma once

#include <algorithm>
#include <span>
#include <string>
#include <vector>

#include "infrasim/config/fields.h"
#include "infrasim/config/scene_config.h"
#include "infrasim/core/numbers.h"
#include "infrasim/scene/curve.h"

namespace infrasim {

/// Returns the distance from a road's centreline to the outer edge of its shoulder (first function)
/// or of its footway (second function).
double carriageway_half_width(const LanesConfig& lanes);
double outer_half_width(const LanesConfig& lanes);

/// Returns the centreline of a road. Arcs are sampled every 0.5 m, or less often if their radius is
/// large.
Curve centreline(const RoadConfig& road);

/// Returns the centrelines of a scene's roads, in the order of the roads.
/// @throws ConfigError if all roads together are longer than 100 km
std::vector<Curve> centrelines(const SceneConfig& scene);

/// A road of a scene.
struct Road {
  const RoadConfig& config;
  const Curve& centreline;
};

/// Returns the road that has the name `name`.
/// @param centrelines centrelines of the scene's roads
/// @param place       position of the entry that names the road
/// @throws ConfigError if the name is unknown
Road road_named(const SceneConfig& scene, std::span<const Curve> centrelines,
                const std::string& name, const config::Place& place);

/// Returns where a row along a road ends: at its `to_m` or at the road's end.
/// @param may_be_point whether a row may start at its end
/// @throws ConfigError for a row that starts beyond its end
template <class Row>
double end_of(const Curve& centreline, const Row& row, bool may_be_point = false) {
  const double to = std::min(row.to_m, centreline.length());
  if (may_be_point ? row.from_m > to : row.from_m >= to)
    config::fail(row.place, "from_m",
                 std::string(may_be_point ? "expected at most" : "expected less than") +
                     " the smaller of to_m and the length of the road, " + fixed_text(to, 2) +
                     " m, got " + config::number_text(row.from_m));
  return to;
}

/// Returns the line of a row along a road, from one end to the other.
/// @throws ConfigError for a row that starts beyond its end
template <class Row>
Curve line_beside(const Curve& centreline, const Row& row) {
  return centreline.part(row.from_m, end_of(centreline, row)).offset(row.offset_m);
}

}  // namespace infrasim
