#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/core/frame.h"
#include "infrasim/pipeline/world.h"

namespace infrasim {

/// Computes frames of several LiDARs at one mount. For one thread at a time.
class FrameSimulator {
 public:
  FrameSimulator(const World& world, std::span<const LidarConfig> lidars);
  ~FrameSimulator();
  FrameSimulator(FrameSimulator&&) noexcept;

  /// Frame k of the LiDARs whose entry in `wanted` is true; the others stay empty. A frame is a
  /// pure function of scene, seed, LiDAR and k.
  /// @throws ConfigError if the scene has no frame k
  std::vector<Frame> simulate(int k, const std::vector<bool>& wanted);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace infrasim
