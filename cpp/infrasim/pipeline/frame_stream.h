#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "infrasim/pipeline/simulate.h"

namespace infrasim {

inline constexpr int kMostThreads = 1024;

/// Frames of all LiDARs in order, computed ahead by threads of its own while the caller works on
/// the ones it has. At most two frames a thread wait.
class FrameStream {
 public:
  /// The world must outlive the stream. Throws ConfigError unless threads are 1 to kMostThreads.
  FrameStream(const World& world, std::vector<LidarConfig> lidars, std::vector<int> frames,
              int threads);
  /// Stops the threads; frames not taken are dropped.
  ~FrameStream();
  FrameStream(const FrameStream&) = delete;
  FrameStream& operator=(const FrameStream&) = delete;

  /// The next frame's number and its data, one per LiDAR; nothing after the last. Blocks.
  /// @throws what the simulation threw
  std::optional<std::pair<int, std::vector<Frame>>> next();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace infrasim
