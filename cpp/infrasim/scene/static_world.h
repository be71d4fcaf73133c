#pragma once

#include "infrasim/core/triangle_mesh.h"
#include "infrasim/scene/curve.h"

namespace infrasim {

/// Where the levelled frame of a mount stands: its position and yaw in the world.
struct LevelPose {
  Vec3 origin;
  double yaw = 0;

  Vec3 to_level(Vec3 world) const;
  Box3d to_level(const Box3d& world) const;
};

LevelPose level_pose(const MountConfig& mount);

/// Everything that stands still, as triangles in the levelled frame.
/// @throws ConfigError if something stands on a lane or names an unknown road
TriangleMesh build_static_mesh(const SceneConfig& scene, const LevelPose& level);

}  // namespace infrasim
