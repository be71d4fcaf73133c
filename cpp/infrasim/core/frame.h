#pragma once

#include <vector>

#include "infrasim/core/classes.h"
#include "infrasim/core/geometry.h"
#include "infrasim/core/point_cloud.h"

namespace infrasim {

/// The time of the boxes in labels: the middle of the frame, or the time when the object was
/// scanned.
enum class LabelTime { kFrame, kScan };

/// One object in the frame of one LiDAR. The boxes are in the levelled frame.
struct ObjectRecord {
  int id = 0;
  Class object_class = Class::kCar;
  Box3d box;  ///< at the middle of the frame
  double speed_m_s = 0;
  int points = 0;          ///< points that lie on the object
  int points_in_box = 0;   ///< points on the object and inside its box, ignoring range noise
  double distance = 0;     ///< horizontal, sensor to box centre, metres
  double visibility = -1;  ///< visible share, [0, 1]; -1 outside the evaluation region
  Box3d scan_box;          ///< at scan_time_s
  double scan_time_s = 0;  ///< mean time of the object's returns, since the start of the frame
  int points_in_scan_box = 0;
};

/// The data of one LiDAR in one frame.
struct Frame {
  PointCloud cloud;
  std::vector<ObjectRecord>
      objects;           ///< every object in range, by id, including objects without a hit
  std::size_t rays = 0;  ///< number of rays fired within the frame
  std::size_t rays_cast =
      0;  ///< rays that were cast: fewer with a static layer, more with wide beams
  bool pitched =
      false;  ///< whether objects of the run have a pitch, so that their table has a column for it
  bool no_plane = false;  ///< a `ground_plane` filter found no plane
  /// computing time of the frame; 0 if the frame was not requested
  double seconds = 0;
};

}  // namespace infrasim
