#pragma once

#include <vector>

#include "infrasim/scene/static_boxes.h"

namespace infrasim {

/// Where leaves are: an upright box, or the ellipsoid within it; the frame is the box's.
struct LeafVolume {
  Box3d box;
  bool ellipsoid = false;
  double density_per_m = 0;  ///< chance per metre that they stop a ray
  config::Place place;
  const char* key;   ///< that says where along its road or in the world it is
  const char* kind;  ///< in words
};

/// True for points inside the volume.
bool holds(const LeafVolume& volume, Vec3 point);

/// Hedges and crowns, world frame.
/// @param centrelines of the scene's roads
/// @throws ConfigError for an unknown road, or a start beyond its end
std::vector<LeafVolume> leaf_volumes(const SceneConfig& scene, std::span<const Curve> centrelines);

/// The solid part of trees.
/// @param centrelines of the scene's roads
/// @throws ConfigError for an unknown road, or a start beyond its end
std::vector<StaticBox> trunks(const SceneConfig& scene, std::span<const Curve> centrelines);

}  // namespace infrasim
