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

/// The surfaces of a scene and their bounding-volume hierarchies, which all mounts share.
struct SceneMeshes {
  Surface surface;  ///< static surfaces, world frame
  LevelPose level;  ///< pose of the library's frame, the levelled frame of the scene's first mount
  std::vector<TriangleMesh> bodies;  ///< meshes in the unit box, in the order of kObjectClasses
  MeshLibrary library;
};
/// @throws IoError, ConfigError if a mesh file of the scene is missing or wrong
std::shared_ptr<const SceneMeshes> build_meshes(const Site& site);

/// A scene at one mount with its trajectories and meshes. It is built once, and all threads share
/// it.
struct World {
  SceneConfig scene;                 ///< scene with only this mount, from scene_at_mount
  std::shared_ptr<const Site> site;  ///< site of the scene with all its mounts
  LevelPose level;
  EvaluationRegion region;
  std::shared_ptr<const Trajectories> trajectories;  ///< trajectories in true time, for all mounts
  std::shared_ptr<const SceneMeshes> meshes;
  CastOrigin cast_origin;  ///< pose of the mount in the frame of the meshes
  Volumes leaves;
  std::map<std::string, StaticLayerFile> static_layers;  ///< static layers from files, by LiDAR
  /// trajectories that are simulated on demand; if set, `trajectories` has no rows
  std::shared_ptr<LazyTrajectories> lazy_trajectories = nullptr;
  double late_s = 0;  ///< clock offset of the mount: true time minus the time of its clock
  /// warnings about the trajectories and meshes that were read, one line each
  // NOLINTNEXTLINE(readability-redundant-member-init): GCC warns of initializers without it
  std::vector<std::string> warnings = {};

  Raycaster raycaster() const { return Raycaster(meshes->library, cast_origin); }
  /// Returns the static surfaces in the levelled frame.
  TriangleMesh background() const { return to_level(meshes->surface, level); }
  /// Returns the number of frames with a period of `period_s` in the scene.
  int frames(double period_s) const { return frame_count(scene.duration_s, period_s); }
  /// Converts a time of the mount's clock to a fractional row number of the trajectories.
  double position(double time_s) const { return row_position(time_s + late_s); }
  /// Returns the objects that exist during the whole of frame k, which lasts from k to k + 1
  /// periods. Each object moves linearly from its state at the start of the frame to its state at
  /// the end.
  std::vector<MovingObject> objects_in_frame(int k, double period_s) const;
};

/// Returns which trajectory rows the frames need. The rows are 0.1 s apart in the time of a mount's
/// clock. A frame needs the rows from the last one at or before its start to the first one at or
/// after its end.
std::vector<bool> rows_of_frames(std::span<const int> frames, double period_s, int steps);
/// Marks in `true_rows` the trajectory rows, in true time, that are needed to compute the rows
/// marked in `rows`. The rows marked in `rows` are in the time of a mount's clock.
/// @param late_s clock offset of the mount: true time minus the time of its clock
void mark_true_rows(const std::vector<bool>& rows, double late_s, std::vector<bool>& true_rows);

/// Builds the world of a scene at a mount.
/// @param mount name of the mount; may be empty if the scene has one mount
/// @throws ConfigError, IoError
World build_world(const SceneConfig& scene, const std::string& mount = "");

/// Like build_world, but traffic is simulated only when frames are requested, and only up to the
/// last requested frame. Recorded trajectories are read and checked at once.
/// @throws the exceptions of build_world, except those of traffic that is simulated later
World build_lazy_world(const SceneConfig& scene, const std::string& mount = "");

/// Builds the world of a checked site at one mount.
/// @param view         scene with only this mount, from scene_at_mount
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
/// Like the function above, but only for the given frames. Traffic is simulated up to the last of
/// these frames. Rows of trajectories that the frames do not require may be omitted.
std::vector<World> build_worlds(const SceneConfig& scene, const std::vector<std::string>& mounts,
                                std::span<const int> frames, double period_s);

/// Builds the worlds of a scene to find errors in the scene. No frame is simulated.
/// @param drive whether the traffic is simulated and checked too
/// @return warnings about trajectories and meshes, one line each
/// @throws the exceptions of build_world
std::vector<std::string> check_worlds(const SceneConfig& scene, bool drive);

/// Returns whether two scenes that were read from the same file have the same traffic and the same
/// sensor positions.
bool move_alike(const SceneConfig& a, const SceneConfig& b);

/// Returns the names of the mounts, in the order of the scene file.
std::vector<std::string> mount_names(const SceneConfig& scene);

/// Returns the objects that overlap within the first minute of simulated traffic, or at any time of
/// recorded trajectories.
/// @throws the exceptions of build_world
std::vector<Overlap> traffic_overlaps(SceneConfig scene);

/// Returns the index of a class in SceneMeshes::bodies.
std::size_t body_index(Class object_class);

/// @throws ConfigError if a scene with this number of frames has no frame k
void check_frame(int frames, int k);

/// Returns all triangles of the scene in the levelled frame, at an instant given as a share of
/// frame k.
/// @throws ConfigError if the scene has no frame k
TriangleMesh frozen_mesh(const World& world, int k, double period_s, double share);

}  // namespace infrasim
