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

/// A frame range A:B or A:B:STEP of a run.
struct FrameRange {
  int first = 0;
  int last = 0;  ///< one past the last frame
  int step = 1;
};

std::vector<int> frame_numbers(const FrameRange& range);

/// The input of a run.
struct RunRequest {
  SceneConfig scene;
  std::vector<LidarConfig> lidars;
  std::string preset;
  FrameRange frames;
  std::filesystem::path out;  ///< output folder; if empty, nothing is written
  /// name of the mount that is simulated; if empty, all mounts are simulated
  std::string mount;
  bool fuse = false;  ///< whether to write the fused frames of all mounts as well
  int threads = 1;
  /// whether static surfaces are cast in every frame, without static layers; this does not change
  /// the frames
  bool cast_all = false;
};

/// Called after each frame, in frame order, with the number of finished frames and the total.
using Progress = std::function<void(int, int)>;

/// Called with each warning for the user, which is one line of text.
using Warn = std::function<void(const std::string&)>;

/// Simulates the frames that are not on disk yet, several at a time. A scene with several mounts
/// gets a folder per mount. Stops after the current frames when `stop` becomes non-zero. Warns of
/// LiDARs that see no vehicle in the first 10 frames. Also warns of a frame step that selects only
/// some of the frames in a period of a scan pattern.
/// @return one row per LiDAR over all requested frames that exist afterwards; with several mounts
///   the rows are named MOUNT/LIDAR and fused/LIDAR
/// @throws ConfigError if the request does not fit the scene
/// @throws IoError if a file can't be written, or the folder belongs to another configuration
std::vector<SummaryRow> run(const RunRequest& request, const std::atomic<int>& stop,
                            const Progress& progress, const Warn& warn);

}  // namespace infrasim
