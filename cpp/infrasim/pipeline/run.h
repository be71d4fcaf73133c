#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/config/scene_config.h"
#include "infrasim/pipeline/summary.h"

namespace infrasim {

/// A:B or A:B:STEP of the frames of a run.
struct FrameRange {
  int first = 0;
  int last = 0;  ///< one past the end
  int step = 1;
};

/// What to simulate, and where to.
struct RunRequest {
  SceneConfig scene;
  std::vector<LidarConfig> lidars;
  std::string preset;
  FrameRange frames;
  std::filesystem::path out;  ///< empty: nothing is written
  std::string mount;          ///< that alone is run; empty: all
  bool fuse = false;          ///< all mounts' frames together, too
  int threads = 1;
  bool cast_all = false;  ///< what stands still too, in every frame; the frames are the same
};

/// Called after each frame, in their order, with the number done and the number in all.
using Progress = std::function<void(int, int)>;

/// Called with a line that says what a user should know.
using Warn = std::function<void(const std::string&)>;

/// Simulates the frames that are not on disk yet, several at a time, of a scene with several mounts
/// to a folder each. Stops after the current frames when `stop` becomes non-zero. Warns of LiDARs
/// that see no vehicle in the first 10 frames, and of steps that show a part of a pattern alone.
/// @return one row per LiDAR over all frames of the request that exist by then; of several mounts
///         named MOUNT/LIDAR, and fused/LIDAR
/// @throws ConfigError if the request does not fit the scene
/// @throws IoError if a file can't be written, or the folder holds another configuration
std::vector<SummaryRow> run(const RunRequest& request, const std::atomic<int>& stop,
                            const Progress& progress, const Warn& warn);

}  // namespace infrasim
