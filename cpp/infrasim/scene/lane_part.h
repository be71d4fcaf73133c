#pragma once

#include <string>
#include <vector>

#include "infrasim/scene/lane_file.h"

namespace infrasim {

/// A point of a lane's centreline, as in a row of roads.csv; world frame.
struct LaneRow {
  double s = 0;  ///< station, metres in the direction of travel
  Vec2 place;
  double z = 0;
  double heading = 0;  ///< direction of travel
  double half_width = 0;
};

/// A part of a lane. The station s is 0 at the point nearest to the sensor's foot, which is the
/// point vertically below the sensor.
struct LanePart {
  std::string name;
  std::vector<LaneRow> rows;  ///< rows at both ends and at every whole metre between them
  Vec2 low, high;             ///< corners of the part's bounding rectangle

  /// Returns true for a point between the first and the last row, within the lane's width plus
  /// `beside` on each side.
  bool contains(Vec2 point, double beside) const;
};

/// Returns the parts of a lane within `radius` of `foot`, in the direction of travel. The second
/// and further parts are named NAME_2 and so on. Parts shorter than 0.1 m are left out.
/// @param foot point vertically below the sensor
std::vector<LanePart> parts_within(const LanePath& lane, Vec2 foot, double radius);

}  // namespace infrasim
