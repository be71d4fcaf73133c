#pragma once

#include <string>

#include "infrasim/pipeline/fusion.h"
#include "infrasim/pipeline/run.h"
#include "infrasim/pipeline/world.h"

namespace infrasim {

/// lidar.yaml: the LiDAR's configuration and what follows from it and the scene, for readers that
/// know no scene.
/// @throws ConfigError for rays that can't be traced
std::string lidar_yaml(const World& world, const LidarConfig& lidar);

/// Creates the folder of a run with the texts that say what is in it (dataset.yaml,
/// trajectories.csv, roads.csv and a lidar.yaml each), or checks that it holds the same run.
/// @throws ConfigError for a LiDAR with rays that can't be traced
/// @throws IoError if a file can't be written, or is there with another text
void open_run_folder(const RunRequest& request, const World& world);

/// The same of all mounts fused, in the frame of the first.
/// @throws what open_run_folder does
void open_fused_folder(const RunRequest& request, const World& first, const Fusion& fusion);

}  // namespace infrasim
