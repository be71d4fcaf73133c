#pragma once

#include <memory>
#include <span>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/config/scene_config.h"
#include "infrasim/core/frame.h"
#include "infrasim/raycast/raycaster.h"
#include "infrasim/scene/region.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// A scene made ready: its trajectories and its meshes. Built once, shared by all threads.
struct World {
  SceneConfig scene;
  LevelFrame frame;
  EvaluationRegion region;
  Trajectories trajectories;
  TriangleMesh background;           ///< levelled frame
  std::vector<TriangleMesh> bodies;  ///< unit box, in the order of kObjectClasses
  std::unique_ptr<const MeshLibrary> meshes;
};

/// @throws ConfigError, IoError
World build_world(const SceneConfig& scene);

/// Time by which the motors of a LiDAR's unit are ahead of the run, drawn from the seed; 0 if the
/// LiDAR's random phase is off.
double start_phase_s(std::uint64_t seed, const LidarConfig& lidar, std::size_t unit);

/// Computes frames of several LiDARs at one mount. For one thread at a time.
class FrameSimulator {
 public:
  FrameSimulator(const World& world, std::span<const LidarConfig> lidars);
  ~FrameSimulator();
  FrameSimulator(FrameSimulator&&) noexcept;

  /// Frame k of the LiDARs whose entry in `wanted` is true; the others stay empty. A frame is a
  /// pure function of scene, seed, LiDAR and k.
  std::vector<Frame> simulate(int k, const std::vector<bool>& wanted);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace infrasim
