#pragma once

#include <string>

#include "infrasim/pipeline/fusion.h"
#include "infrasim/pipeline/run.h"
#include "infrasim/pipeline/world.h"

namespace infrasim {

/// Returns the text of lidar.yaml: the LiDAR's configuration, and values that are derived from the
/// configuration and the scene. Programs that read frames therefore need not read the scene.
/// @throws ConfigError for rays that can't be traced
std::string lidar_yaml(const World& world, const LidarConfig& lidar);

/// Creates the folder of a run with the files that identify it (dataset.yaml, trajectories.csv,
/// roads.csv and a lidar.yaml per LiDAR), or checks that an existing folder belongs to the same
/// run. The rows of the requested frames are added to trajectories.csv.
/// @throws ConfigError for a LiDAR with rays that can't be traced
/// @throws IoError if a file can't be written, or exists with another content
void open_run_folder(const RunRequest& request, const World& world);

/// Like open_run_folder, but for the fused frames, which are in the levelled frame of the first
/// mount.
/// @throws the exceptions of open_run_folder
void open_fused_folder(const RunRequest& request, const World& first, const Fusion& fusion);

}  // namespace infrasim
