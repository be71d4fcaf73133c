#pragma once

#include <vector>

#include "infrasim/core/classes.h"
#include "infrasim/core/geometry.h"
#include "infrasim/core/point_cloud.h"

namespace infrasim {

/// The time of the boxes in labels: the middle of the frame, or the time when the object was
/// scanned.
enum class LabelTime { kFrame, kScan };

/// One object in one frame of a LiDAR. The boxes are in the levelled LiDAR frame.
struct ObjectRecord {
  int id = 0;
  Class object_class = Class::kCar;
  Box3d box;  ///< box at the middle of the frame
  double speed_m_s = 0;
  int points = 0;  ///< number of points on the object
  /// number of points on the object whose position without range noise is inside `box`
  int points_in_box = 0;
  double distance = 0;     ///< horizontal distance from sensor to box centre, m
  double visibility = -1;  ///< visible share, [0, 1]; -1 outside the evaluation region
  Box3d scan_box;          ///< box at the time `scan_time_s`
  double scan_time_s = 0;  ///< mean time of the object's returns, since the start of the frame
  int points_in_scan_box = 0;
};

/// The data of one LiDAR in one frame.
struct Frame {
  PointCloud cloud;
  std::vector<ObjectRecord>
      objects;           ///< every object in range, sorted by id, including objects without a hit
  std::size_t rays = 0;  ///< number of rays fired within the frame
  /// number of rays cast: fewer than `rays` with stored hits of static surfaces, more with sub-rays
  /// of wide beams
  std::size_t rays_cast = 0;
  bool pitched =
      false;  ///< whether objects have a pitch, so that their table has a column for the pitch
  bool no_plane = false;  ///< whether a `ground_plane` filter found no plane
  /// computing time of the frame; 0 if the frame was not requested
  double seconds = 0;
};

}  // namespace infrasim
