#pragma once

#include <cstddef>
#include <vector>

#include "infrasim/scene/traffic_state.h"

namespace infrasim {

/// Decides which vehicles may enter junctions, by signals or by gaps in the traffic of a
/// roundabout.
class TrafficSignals {
 public:
  explicit TrafficSignals(const LaneNetwork& network);

  /// Advances the signals by one time step.
  void update(const TrafficState& state);
  /// Looks for gaps at the approaches of roundabouts.
  void find_gaps(const TrafficState& state);

  bool is_green(int approach) const;
  /// Returns the number of lanes of an approach.
  std::size_t lanes_of(int approach) const { return arms_[approach].lanes.size(); }

 private:
  /// The signals of one junction. The approaches have green one after the other. The next green
  /// phase starts when the junction is empty, so that vehicles never use crossing paths at the same
  /// time.
  struct Signal {
    std::vector<int> approaches;
    std::size_t current = 0;
    bool green = true;
    double since = 0;
  };
  /// The lanes of one direction of a road that end at a junction.
  struct Arm {
    std::vector<int> lanes;
    bool gap = false;  ///< whether a vehicle may enter the roundabout from this arm
  };

  static bool is_clear(const TrafficState& state, int junction);
  bool has_gap(const TrafficState& state, int approach) const;

  const LaneNetwork& network_;
  std::vector<Signal> signals_;  ///< signals of each junction
  std::vector<Arm> arms_;        ///< lanes of each approach
};

}  // namespace infrasim
