#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "infrasim/pipeline/scheduler.h"

namespace infrasim {

/// Provides the frames of all LiDARs in order. Its threads compute further frames while the caller
/// processes earlier ones. At most two finished frames per thread wait.
class FrameStream {
 public:
  /// The world must outlive the stream.
  /// @throws ConfigError unless threads is 1 to kMostThreads, if the scene has a block for the
  ///   LiDARs' preset but was read for another preset, and if the LiDARs have different periods
  FrameStream(const World& world, const std::vector<LidarConfig>& lidars, std::vector<int> frames,
              int threads);

  /// Returns the next frame's number and its data, one Frame per LiDAR. Returns no value after the
  /// last frame. The function waits until the frame is computed.
  /// @throws the exceptions of the simulation
  std::optional<std::pair<int, std::vector<Frame>>> next() { return scheduler_.next(); }

 private:
  Scheduler<std::vector<Frame>> scheduler_;
};

}  // namespace infrasim
