#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "infrasim/pipeline/scheduler.h"

namespace infrasim {

/// Frames of all LiDARs in order. Its own threads compute ahead while the caller processes earlier
/// frames. At most two frames per thread wait.
class FrameStream {
 public:
  /// The world must outlive the stream.
  /// @throws ConfigError unless threads is 1 to kMostThreads, and if the scene has a block for the
  ///   LiDARs' preset but was read for another preset
  FrameStream(const World& world, const std::vector<LidarConfig>& lidars, std::vector<int> frames,
              int threads);

  /// The next frame's number and its data, one Frame per LiDAR; nothing after the last. Blocks.
  /// @throws the exceptions of the simulation
  std::optional<std::pair<int, std::vector<Frame>>> next() { return scheduler_.next(); }

 private:
  Scheduler<std::vector<Frame>> scheduler_;
};

}  // namespace infrasim
