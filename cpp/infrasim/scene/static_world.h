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

inline constexpr double kSidewalkDrop =
    0.01;  ///< m below the road, so that crossing roads are on top

/// A box that stands on the ground or hangs over it.
struct Upright {
  Box3d box;
  config::Place place;
  const char* key;   ///< that says where along its road or in the world it is
  const char* kind;  ///< in words
};

/// Buildings, the legs and beams of gantries, and trunks of trees.
/// @throws ConfigError for a gantry or trees of an unknown road or beyond its end
std::vector<Upright> uprights(const SceneConfig& scene);

/// A barrier as boxes of up to `longest_m`.
/// @throws ConfigError for an unknown road, or a start beyond its end
std::vector<Box3d> barrier_pieces(const SceneConfig& scene, const BarrierConfig& barrier,
                                  double longest_m = 2);

/// Everything that stands still, as triangles in the levelled frame.
/// @throws ConfigError if something names an unknown road
TriangleMesh build_static_mesh(const SceneConfig& scene, const LevelPose& level);

}  // namespace infrasim
