#pragma once

#include <vector>

#include "infrasim/scene/static_world.h"

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
/// @throws ConfigError for an unknown road, or a start beyond its end
std::vector<LeafVolume> leaf_volumes(const SceneConfig& scene);

/// The solid part of trees.
/// @throws ConfigError for an unknown road, or a start beyond its end
std::vector<Upright> trunks(const SceneConfig& scene);

}  // namespace infrasim
