#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "infrasim/pipeline/scheduler.h"

namespace infrasim {

/// Frames of all LiDARs in order, computed ahead by threads of its own while the caller works on
/// the ones it has. At most two frames a thread wait.
class FrameStream {
 public:
  /// The world must outlive the stream.
  /// @throws ConfigError unless threads are 1 to kMostThreads, and for LiDARs of a preset that the
  /// scene has a block for and was not read for
  FrameStream(const World& world, const std::vector<LidarConfig>& lidars, std::vector<int> frames,
              int threads);

  /// The next frame's number and its data, one per LiDAR; nothing after the last. Blocks.
  /// @throws what the simulation threw
  std::optional<std::pair<int, std::vector<Frame>>> next() { return scheduler_.next(); }

 private:
  Scheduler<std::vector<Frame>> scheduler_;
};

}  // namespace infrasim
