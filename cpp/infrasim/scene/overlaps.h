#pragma once

#include <set>
#include <utility>
#include <vector>

#include "infrasim/scene/trajectories.h"

namespace infrasim {

inline constexpr double kTouch_m = 0.001;  ///< overlaps up to this size count as touching

/// Two objects that overlap.
struct Overlap {
  int first_id = 0;  ///< the smaller id
  int second_id = 0;
  double time_s = 0;
  Vec2 place;  ///< half way between the centres of the objects, world frame
};

/// Finds overlapping objects at each instant and half way between two instants. The footprints of
/// two boxes are tested with separating axes, and then the heights of the boxes.
class OverlapSearch {
 public:
  /// Adds the objects of the next instant, 0.1 s after the previous one.
  void take(const std::vector<ObjectState>& states);

  /// Returns each overlapping pair once, with the time and position of the first overlap. The pairs
  /// are in time order.
  const std::vector<Overlap>& overlaps() const { return overlaps_; }

 private:
  void look(const std::vector<std::pair<int, Box3d>>& boxes, double time_s);

  std::vector<ObjectState> before_;  ///< objects of the previous instant
  int instants_ = 0;
  std::set<std::pair<int, int>> pairs_;
  std::vector<Overlap> overlaps_;
};

}  // namespace infrasim
