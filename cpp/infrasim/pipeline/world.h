#pragma once

#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "infrasim/config/scene_config.h"
#include "infrasim/core/triangle_mesh.h"
#include "infrasim/pipeline/static_layer_file.h"
#include "infrasim/raycast/raycaster.h"
#include "infrasim/raycast/volumes.h"
#include "infrasim/scene/overlaps.h"
#include "infrasim/scene/region.h"
#include "infrasim/scene/site.h"
#include "infrasim/scene/static_world.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// A scene at one mount made ready: its trajectories and its meshes. Built once, shared by all
/// threads.
struct World {
  SceneConfig scene;                 ///< scene_at_mount the mount
  std::shared_ptr<const Site> site;  ///< of the scene with all its mounts
  LevelPose level;
  EvaluationRegion region;
  std::shared_ptr<const Trajectories> trajectories;  ///< by the mount's clock
  TriangleMesh background;                           ///< levelled frame
  std::vector<TriangleMesh> bodies;                  ///< unit box, in the order of kObjectClasses
  std::unique_ptr<const MeshLibrary> meshes;
  Volumes leaves;
  std::map<std::string, StaticLayerFile> static_layers;  ///< by LiDAR, in place of casting
};

/// @param mount its name; empty: the only one
/// @throws ConfigError, IoError
World build_world(const SceneConfig& scene, const std::string& mount = "");

/// One for each of the mounts, all with the same vehicles.
/// @throws what build_world does
std::vector<World> build_worlds(const SceneConfig& scene, const std::vector<std::string>& mounts);
/// The same for some frames: rows that none of them needs may be left out.
/// @param to_end  whether the whole scene is driven and looked at, or up to the last of the frames
std::vector<World> build_worlds(const SceneConfig& scene, const std::vector<std::string>& mounts,
                                std::span<const int> frames, bool to_end);

/// Builds the worlds of a scene for no frame, to find what is wrong with it.
/// @param drive whether its vehicles are looked at, too
/// @throws what build_world does
void check_worlds(const SceneConfig& scene, bool drive);

/// Whether in two scenes of one file the same vehicles move past the same sensors.
bool move_alike(const SceneConfig& a, const SceneConfig& b);

/// Hands over the trajectories of a world whole, whichever rows it has.
void each_instant(const World& world, const StateSink& sink);

/// In the order of the file.
std::vector<std::string> mount_names(const SceneConfig& scene);

/// Vehicles that are in one place within a minute of a scene's traffic, or at any time of its
/// recorded trajectories.
/// @throws what build_world does
std::vector<Overlap> traffic_overlaps(SceneConfig scene);

/// Index of a class in World::bodies.
std::size_t body_index(Class object_class);

/// @throws ConfigError if the scene has no frame k
void check_frame(const World& world, int k);

/// All triangles at one instant, as a share of frame k; levelled frame.
/// @throws ConfigError if the scene has no frame k
TriangleMesh frozen_mesh(const World& world, int k, double share);

}  // namespace infrasim
