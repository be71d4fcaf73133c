#pragma once

#include <vector>

#include "infrasim/core/classes.h"
#include "infrasim/core/geometry.h"
#include "infrasim/core/point_cloud.h"

namespace infrasim {

/// Whether labels show vehicles at the middle of the frame or when they were scanned.
enum class LabelTime { kFrame, kScan };

/// One vehicle as one LiDAR sees it; levelled frame.
struct ObjectRecord {
  int id = 0;
  Class object_class = Class::kCar;
  Box3d box;  ///< at the middle of the frame
  double speed_m_s = 0;
  int points = 0;          ///< points that lie on it
  int points_in_box = 0;   ///< those of them inside its box, were there no range noise
  double distance = 0;     ///< horizontal, sensor to box centre, metres
  double visibility = -1;  ///< share that nothing hides, [0, 1]; -1 outside the evaluation region
  Box3d scan_box;          ///< at scan_time_s
  double scan_time_s = 0;  ///< mean time of its returns, since the start of the frame
  int points_in_scan_box = 0;
};

/// What one LiDAR gives for one frame.
struct Frame {
  PointCloud cloud;
  std::vector<ObjectRecord> objects;  ///< every vehicle in reach, hit or not, by id
  std::size_t rays = 0;               ///< answered: fired within the frame
  std::size_t rays_cast = 0;          ///< fewer where a static layer answers, more for wide beams
  bool pitched = false;               ///< vehicles of the run pitch: their table has the column
  bool no_plane = false;              ///< a `ground_plane` filter found none
  double seconds = 0;  ///< from vehicles and rays to columns; 0 if the frame was not asked for
};

}  // namespace infrasim
