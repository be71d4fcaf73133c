#pragma once

#include <string>
#include <vector>

#include "infrasim/scene/lane_file.h"

namespace infrasim {

/// A point of a lane's centreline, as a row of roads.csv has it; world frame.
struct LaneRow {
  double s = 0;  ///< m in the direction of travel
  Vec2 place;
  double z = 0;
  double heading = 0;  ///< of travel
  double half_width = 0;
};

/// A stretch of a lane: 0 is where it is nearest to the sensor's foot.
struct LanePart {
  std::string name;
  std::vector<LaneRow> rows;  ///< both ends, and every whole metre between them
  Vec2 low, high;             ///< corners of a rectangle that holds it

  /// True within its width and `beside` more on both sides, between its first and its last row;
  /// nothing is added at the ends.
  bool contains(Vec2 point, double beside) const;
};

/// What of a lane lies within `radius` of the sensor's foot, in the order of travel. The second and
/// further parts are named NAME_2 and so on. Stretches below a tenth of a metre are left out.
std::vector<LanePart> parts_within(const LanePath& lane, Vec2 foot, double radius);

}  // namespace infrasim
