#pragma once

#include <span>
#include <string>
#include <vector>

#include "infrasim/config/scene_config.h"
#include "infrasim/scene/curve.h"

namespace infrasim {

/// Distance from a road's centreline to the outer edge of its shoulder (first function) or of its
/// footway (second function).
double carriageway_half_width(const LanesConfig& lanes);
double outer_half_width(const LanesConfig& lanes);

/// Returns the centreline of a road. Arcs are sampled every 0.5 m, or less often if their radius is
/// large.
Curve centreline(const RoadConfig& road);

/// The centrelines of a scene's roads, in the order of the roads.
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

}  // namespace infrasim
