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
#include "infrasim/scene/lazy_trajectories.h"
#include "infrasim/scene/overlaps.h"
#include "infrasim/scene/region.h"
#include "infrasim/scene/site.h"
#include "infrasim/scene/static_world.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// The surfaces of a scene and their hierarchies, which all mounts share.
struct SceneMeshes {
  Surface surface;  ///< static surfaces, world frame
  LevelPose level;  ///< pose of the library's frame: the levelled frame of the scene's first mount
  std::vector<TriangleMesh> bodies;  ///< in the unit box, in the order of kObjectClasses
  MeshLibrary library;
};
/// @throws IoError, ConfigError for a file of `meshes`
std::shared_ptr<const SceneMeshes> build_meshes(const Site& site);

/// A scene at one mount with its trajectories and meshes. It is built once, and all threads share
/// it.
struct World {
  SceneConfig scene;                 ///< the result of scene_at_mount
  std::shared_ptr<const Site> site;  ///< site of the scene with all its mounts
  LevelPose level;
  EvaluationRegion region;
  std::shared_ptr<const Trajectories> trajectories;  ///< in the time of the mount's clock
  std::shared_ptr<const SceneMeshes> meshes;
  Viewpoint viewpoint;  ///< of the mount in the frame of the meshes
  Volumes leaves;
  std::map<std::string, StaticLayerFile> static_layers;  ///< static layers from files, by LiDAR
  /// in the time of the mount's clock; if set, `trajectories` has no rows
  std::shared_ptr<LazyTrajectories> lazy_trajectories = nullptr;
  /// what is suspicious about the trajectories and meshes that were read, one line per finding
  std::vector<std::string> warnings = {};

  Raycaster raycaster() const { return Raycaster(meshes->library, viewpoint); }
  /// Static surfaces; levelled frame.
  TriangleMesh background() const { return to_level(meshes->surface, level); }
  /// Objects that exist for the whole of frame k.
  std::vector<MovingObject> objects_in_frame(int k) const;
};

/// Builds the world of a scene at a mount.
/// @param mount name of the mount; may be empty if the scene has one mount
/// @throws ConfigError, IoError
World build_world(const SceneConfig& scene, const std::string& mount = "");

/// Like build_world, but traffic is simulated only when frames are requested, and only up to the
/// last requested frame. Recorded trajectories are read and checked at once.
/// @throws the exceptions of build_world, except those of traffic that is simulated later
World build_lazy_world(const SceneConfig& scene, const std::string& mount = "");

/// Builds the world of a checked site at one mount.
/// @param view         the result of scene_at_mount
/// @param site         site of the scene
/// @param meshes       meshes of the site
/// @param trajectories trajectories of the scene
/// @throws ConfigError
World build_world_at(const SceneConfig& view, const std::shared_ptr<const Site>& site,
                     const std::shared_ptr<const SceneMeshes>& meshes,
                     std::shared_ptr<const Trajectories> trajectories);

/// Builds a world of static objects only, which has no frames. Traffic and recorded trajectories
/// are not required.
/// @throws the exceptions of build_world
World build_static_world(const SceneConfig& scene, const std::string& mount = "");

/// Builds one world per mount. All worlds have the same objects.
/// @throws the exceptions of build_world
std::vector<World> build_worlds(const SceneConfig& scene, const std::vector<std::string>& mounts);
/// Like the function above, but only for some frames. Rows of trajectories that these frames do not
/// require may be omitted.
/// @param to_end  whether to simulate and check the whole scene, or only up to the last of the
///   frames
std::vector<World> build_worlds(const SceneConfig& scene, const std::vector<std::string>& mounts,
                                std::span<const int> frames, bool to_end);

/// Builds the worlds of a scene without frames, to find its errors.
/// @param drive whether the traffic is simulated and checked too
/// @return warnings as in World
/// @throws the exceptions of build_world
std::vector<std::string> check_worlds(const SceneConfig& scene, bool drive);

/// Returns whether two scenes from one file have the same traffic and the same sensor positions.
bool move_alike(const SceneConfig& a, const SceneConfig& b);

/// Passes all instants of a world's trajectories to `sink`, including rows that the world has
/// omitted.
void each_instant(const World& world, const StateSink& sink);

/// Names of the mounts, in the order of the file.
std::vector<std::string> mount_names(const SceneConfig& scene);

/// Returns the objects that overlap within the first minute of simulated traffic, or at any time of
/// recorded trajectories.
/// @throws the exceptions of build_world
std::vector<Overlap> traffic_overlaps(SceneConfig scene);

/// Index of a class in SceneMeshes::bodies.
std::size_t body_index(Class object_class);

/// @throws ConfigError if the scene has no frame k
void check_frame(const World& world, int k);

/// Returns all triangles at one instant, which is given as a share of frame k. Levelled frame.
/// @throws ConfigError if the scene has no frame k
TriangleMesh frozen_mesh(const World& world, int k, double share);

}  // namespace infrasim
