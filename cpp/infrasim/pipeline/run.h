#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/config/scene_config.h"

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
  int threads = 1;
};

/// One row of summary.csv.
struct SummaryRow {
  std::string lidar;
  std::string preset;
  int frames = 0;
  double rays_per_frame = 0;
  double hits_per_frame = 0;
  double vehicles_per_frame = 0;
  double vehicle_points_per_frame = 0;
  double seconds = 0;      ///< from rays to columns, summed over threads and divided by them
  double mrays_per_s = 0;  ///< millions of rays cast per such second
};

/// Called after each frame with the number done and the number in all.
using Progress = std::function<void(int, int)>;

/// Simulates the frames that are not on disk yet, several at a time. Stops after the current
/// frames when `stop` becomes non-zero.
/// @return one row per LiDAR over all frames of the request that exist by then
/// @throws ConfigError if the request does not fit the scene
/// @throws IoError if a file can't be written, or the folder holds another configuration
std::vector<SummaryRow> run(const RunRequest& request, const std::atomic<int>& stop,
                            const Progress& progress);

std::string summary_csv(const std::vector<SummaryRow>& rows);

}  // namespace infrasim
