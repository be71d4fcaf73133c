#pragma once

#include "infrasim/core/triangle_mesh.h"
#include "infrasim/scene/site.h"

namespace infrasim {

/// Pose of the levelled frame of a mount: its position and yaw in the world.
struct LevelPose {
  Vec3 origin;
  double yaw = 0;

  Vec3 to_level(Vec3 world) const;
  Box3d to_level(const Box3d& world) const;
};

LevelPose level_pose(const MountConfig& mount);

inline constexpr double kSidewalkDrop =
    0.01;  ///< depth of a footway below its road, m; crossing roads lie above the footway

/// Returns all static surfaces in the world frame, raised by the elevation profile.
/// @throws IoError, ConfigError for a file of `meshes`
Surface build_static_surface(const Site& site);

/// Returns the triangles of a surface in the levelled frame.
TriangleMesh to_level(const Surface& surface, const LevelPose& level);

}  // namespace infrasim
