#pragma once

#include <filesystem>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/config/scene_config.h"
#include "infrasim/pipeline/static_layer.h"

namespace infrasim {

/// A static layer made from a recording of the real site, and measures of the recording's quality.
struct RecordedLayer {
  std::vector<StaticHits> units;
  int frames = 0;  ///< number of frames used
  /// mean elevation error of the points of the ring with the largest mean error
  double elevation_miss_deg = 0;
  /// azimuth offset of the recorded columns, by unit; 0 if the offset is not constant
  std::vector<double> azimuth_offsets_deg;
  std::size_t too_far = 0;  ///< number of rays whose returns lie beyond the LiDAR's range
};

/// Makes a static layer from recorded frames of the empty site, which are stored in this project's
/// layout with `fields`. Each ray uses the returns of its ring that are nearest in azimuth, so
/// frames may begin at any azimuth. The range of a ray is the mean of its largest group of returns
/// within 0.3 m of each other, or within 6 times the range accuracy if that is more. The group must
/// have a return in at least half of the frames. At most 100 evenly spaced frames are used.
/// @param scene  scene whose mount has the pitch and roll of the recording sensor
/// @param folder folder of the recorded LiDAR, DATA/LIDAR
/// @throws ConfigError for a LiDAR that does not spin or repeat, fewer than 20 frames, frames
///   without `fields`, rings that the LiDAR does not have, or an elevation error above 0.1 degrees;
///   IoError
RecordedLayer recorded_static_layer(const SceneConfig& scene, const LidarConfig& lidar,
                                    const std::filesystem::path& folder);

}  // namespace infrasim
