#pragma once

#include <span>
#include <vector>

#include "infrasim/config/scene_config.h"
#include "infrasim/scene/roads.h"

namespace infrasim {

/// A static box on the ground or above it.
struct StaticBox {
  Box3d box;
  config::Place place;
  const char* key;   ///< key of the box's position along a road or in the world
  const char* kind;  ///< kind of object, for messages
};

/// Returns the buildings, the legs and beams of gantries, and trunks of trees.
/// @param centrelines centrelines of the scene's roads
/// @throws ConfigError for a gantry or trees on an unknown road or beyond a road's end
std::vector<StaticBox> static_boxes(const SceneConfig& scene, std::span<const Curve> centrelines);

/// Returns a barrier as boxes of up to `longest_m` length.
/// @param road the road that the barrier names
/// @throws ConfigError for a barrier that starts beyond the road's end
std::vector<Box3d> barrier_pieces(const Road& road, const BarrierConfig& barrier,
                                  double longest_m = 2);

}  // namespace infrasim
