#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "infrasim/core/frame.h"
#include "infrasim/pipeline/world.h"

namespace infrasim {

/// What one LiDAR gives at all mounts, levelled frame of the first.
struct FusedFrame {
  Frame frame;
  std::vector<std::uint16_t> mount;  ///< of each point, counted from 0 in the scene's order
};

/// Puts frames of several mounts together as one who knows where the mounts should stand.
class Fusion {
 public:
  /// @param scene  with all its mounts
  /// @param worlds one for each mount, in the scene's order; outlive the fusion
  Fusion(const SceneConfig& scene, std::span<const World> worlds);

  /// Points lie where the mounts' assumed poses have them, and keep their mounts' time stamps.
  /// Labels are by the first mount's clock, at the mean time of all points of a vehicle.
  /// @param frames number k of one LiDAR, one for each mount
  FusedFrame fuse(int k, std::span<const Frame* const> frames) const;

  /// Where a sensor truly stands in the levelled frame of the first mount.
  MountConfig seen_from_first(std::size_t mount) const;

 private:
  struct RigidTransform {
    Mat3 rotation_to_first;  ///< from a mount's levelled frame to that of the first
    Vec3 origin_in_first;
    double late_s;  ///< its clock, behind the first mount's
  };
  RigidTransform transform_of(const MountConfig& mount) const;
  void add_points(const Frame& frame, std::size_t mount, FusedFrame& out) const;
  ObjectRecord record(const MovingObject& object, std::span<const Frame* const> frames) const;

  const World& first_;
  std::vector<MountConfig> mounts_;
  std::vector<RigidTransform> transforms_;
};

}  // namespace infrasim
