#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/config/scene_config.h"
#include "infrasim/pipeline/simulate.h"
#include "infrasim/scene/region.h"
#include "infrasim/scene/site.h"
#include "infrasim/scene/static_world.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// Measures what LiDARs see of the objects of one site from many poses. The site and the traffic
/// are built once. An object counts if it is in the evaluation region of the scene's mount, so that
/// the same objects count for all poses. Thread-safe.
class Observer {
 public:
  /// @param mount  name of the mount whose region counts; may be empty if the scene has one mount
  /// @param frames the frames that may be observed
  /// @param period_s frame period of the LiDARs
  /// @throws the exceptions of build_worlds
  Observer(const SceneConfig& scene, const std::string& mount, std::span<const int> frames,
           double period_s);

  double frame_period_s() const { return period_s_; }

  /// Returns the reason why a sensor can't be at a pose. The text is empty if the pose is possible.
  std::string fault(const MountConfig& pose) const;

  /// Returns the objects that each LiDAR sees: one list per frame, with one list per LiDAR in it.
  /// @throws ConfigError for a pose with a fault, a frame that can't be observed, or a LiDAR with
  ///   another frame period
  std::vector<std::vector<std::vector<Observation>>> observe(const MountConfig& pose,
                                                             std::span<const LidarConfig> lidars,
                                                             std::span<const int> frames) const;

  /// Returns the objects in the region at the middle of a frame, in the world frame.
  /// @throws ConfigError for a frame that can't be observed
  std::vector<MovingObject> present(int frame) const;

 private:
  void check(int frame) const;

  double period_s_;
  std::string mount_;
  std::shared_ptr<const Site> site_;
  std::optional<EvaluationRegion> region_;
  std::shared_ptr<const Trajectories> trajectories_;
  std::shared_ptr<const SceneMeshes> meshes_;
};

}  // namespace infrasim
