#pragma once

#include <filesystem>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/config/scene_config.h"
#include "infrasim/pipeline/static_layer.h"

namespace infrasim {

/// A static layer as a recording of the real place has it, and how well the two fit.
struct RecordedLayer {
  std::vector<StaticHits> units;
  int frames = 0;                           ///< that were looked at
  double elevation_miss_deg = 0;            ///< of the worst ring, mean over its points
  std::vector<double> azimuth_offsets_deg;  ///< of the recorded columns, by unit; 0: not constant
  std::size_t too_far = 0;                  ///< rays whose returns lie beyond the LiDAR's range
};

/// What each ray of a period saw in frames of the empty site, in our layout with `fields`: the mean
/// of the largest group of returns within 0.3 m of each other (6 range_accuracy_m, if that is
/// more), if half of the frames have it, of the nearest ring and column. At most 100 frames, evenly
/// spread. A point is placed by its direction, so frames may begin at any azimuth.
/// @param scene  its mount has the pitch and roll of the recording sensor
/// @param folder DATA/LIDAR
/// @throws ConfigError for a LiDAR that does not spin or repeat, fewer than 20 frames, frames
///         without `fields`, rings that it does not have or whose elevations miss by above 0.1
///         degrees; IoError
RecordedLayer recorded_static_layer(const SceneConfig& scene, const LidarConfig& lidar,
                                    const std::filesystem::path& folder);

}  // namespace infrasim
