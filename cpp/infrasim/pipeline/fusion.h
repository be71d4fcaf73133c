#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "infrasim/core/frame.h"
#include "infrasim/pipeline/world.h"

namespace infrasim {

/// Merged points and objects of one LiDAR model at all mounts, in the levelled coordinate frame of
/// the first mount.
struct FusedFrame {
  Frame frame;
  std::vector<std::uint16_t> mount;  ///< mount index of each point, from 0 in the scene's order
};

/// Merges frames of several mounts, using the assumed poses of the mounts.
class Fusion {
 public:
  /// @param scene  scene with all its mounts
  /// @param worlds one world per mount, in the scene's order; must outlive the fusion
  /// @param period_s frame period of the LiDARs
  Fusion(const SceneConfig& scene, std::span<const World> worlds, double period_s);

  /// Merges the frames of all mounts. Points are transformed by the assumed poses of the mounts,
  /// and keep the time stamps of their mounts. The scan time of an object is the mean time of its
  /// points from all mounts, on the clock of the first mount.
  /// @param frames frame k of one LiDAR at each mount, in the order of the mounts
  FusedFrame fuse(int k, std::span<const Frame* const> frames) const;

  /// Returns the true pose of a mount's sensor in the levelled frame of the first mount.
  MountConfig seen_from_first(std::size_t mount) const;

 private:
  struct RigidTransform {
    /// rotation from a mount's levelled frame to the levelled frame of the first mount
    Mat3 rotation_to_first;
    Vec3 origin_in_first;
    double late_s;  ///< delay of the mount's clock relative to the clock of the first mount
  };
  RigidTransform transform_of(const MountConfig& mount) const;
  void add_points(const Frame& frame, std::size_t mount, FusedFrame& out) const;
  ObjectRecord record(const MovingObject& object, std::span<const Frame* const> frames) const;

  const World& first_;
  double period_s_;
  std::vector<MountConfig> mounts_;
  std::vector<RigidTransform> transforms_;
};

}  // namespace infrasim
