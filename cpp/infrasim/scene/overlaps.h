#pragma once

#include <set>
#include <utility>
#include <vector>

#include "infrasim/scene/trajectories.h"

namespace infrasim {

inline constexpr double kTouch_m =
    0.001;  ///< what two vehicles may share and do no more than touch

/// Two vehicles in one place.
struct Overlap {
  int first_id = 0;  ///< the smaller one
  int second_id = 0;
  double time_s = 0;
  Vec2 place;  ///< half way between their centres, world frame
};

/// Finds vehicles that are in one place, at each instant and half way between two: oriented boxes,
/// by a separating axis in the plane and their heights.
class OverlapSearch {
 public:
  /// The vehicles of the next instant, 0.1 s after the last.
  void take(const std::vector<ObjectState>& states);

  /// Every pair once, with the time and place of its first overlap, in the order of time.
  const std::vector<Overlap>& overlaps() const { return overlaps_; }

 private:
  void look(const std::vector<std::pair<int, Box3d>>& boxes, double time_s);

  Trajectories window_;  ///< the last two instants
  int instants_ = 0;
  std::set<std::pair<int, int>> pairs_;
  std::vector<Overlap> overlaps_;
};

}  // namespace infrasim
