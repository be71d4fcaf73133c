#pragma once

#include <vector>

#include "infrasim/scene/static_boxes.h"

namespace infrasim {

/// A volume of leaves: an upright box, or the largest ellipsoid in the box.
struct LeafVolume {
  Box3d box;
  bool ellipsoid = false;
  double density_per_m = 0;  ///< probability per metre that leaves stop a ray
  config::Place place;
  const char* key;   ///< key of the volume's position along a road or in the world
  const char* kind;  ///< kind of object, for messages
};

/// Returns whether a point is inside the volume.
bool holds(const LeafVolume& volume, Vec3 point);

/// Returns the hedges and the crowns of trees, in the world frame.
/// @param centrelines centrelines of the scene's roads
/// @throws ConfigError for an unknown road, or a start beyond a road's end
std::vector<LeafVolume> leaf_volumes(const SceneConfig& scene, std::span<const Curve> centrelines);

/// Returns the trunks of trees.
/// @param centrelines centrelines of the scene's roads
/// @throws ConfigError for an unknown road, or a start beyond a road's end
std::vector<StaticBox> trunks(const SceneConfig& scene, std::span<const Curve> centrelines);

}  // namespace infrasim
