#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "infrasim/pipeline/scheduler.h"

namespace infrasim {

/// Provides the frames of all LiDARs in order. Its threads compute further frames while the caller
/// processes earlier ones. At most two frames per thread are computed in advance.
class FrameStream {
 public:
  /// The world must outlive the stream.
  /// @throws ConfigError if the number of threads is not 1 to kMostThreads, if a LiDAR has another
  ///   preset than the scene and the scene file has a block for either preset, or if the LiDARs
  ///   have different periods
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
