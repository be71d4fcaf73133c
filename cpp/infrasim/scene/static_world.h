#pragma once

#include "infrasim/core/triangle_mesh.h"
#include "infrasim/scene/site.h"

namespace infrasim {

/// Where the levelled frame of a mount stands: its position and yaw in the world.
struct LevelPose {
  Vec3 origin;
  double yaw = 0;

  Vec3 to_level(Vec3 world) const;
  Box3d to_level(const Box3d& world) const;
};

LevelPose level_pose(const MountConfig& mount);

inline constexpr double kSidewalkDrop =
    0.01;  ///< m below the road, so that crossing roads are on top

/// Everything that stands still, lifted by the profile; world frame.
/// @throws IoError, ConfigError for a file of `meshes`
Surface build_static_surface(const Site& site);

/// The same triangles in the levelled frame.
TriangleMesh to_level(const Surface& surface, const LevelPose& level);

}  // namespace infrasim
