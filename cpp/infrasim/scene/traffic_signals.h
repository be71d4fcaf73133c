#pragma once

#include <cstddef>
#include <vector>

#include "infrasim/scene/traffic_state.h"

namespace infrasim {

/// Who may enter a junction: by signals, or by gaps in the traffic of a roundabout.
class TrafficSignals {
 public:
  explicit TrafficSignals(const LaneNetwork& network);

  /// One step of the signals.
  void update(const TrafficState& state);
  /// Looks for gaps at the approaches of roundabouts.
  void find_gaps(const TrafficState& state);

  bool is_green(int approach) const;
  /// How many lanes an approach has.
  std::size_t lanes_of(int approach) const { return arms_[approach].lanes.size(); }

 private:
  /// Greens of one junction, one approach after the other; the next one starts when the junction
  /// is empty, so that paths that cross are never driven together.
  struct Signal {
    std::vector<int> approaches;
    std::size_t current = 0;
    bool green = true;
    double since = 0;
  };
  /// The lanes of one direction of a road that end at a junction.
  struct Arm {
    std::vector<int> lanes;
    bool gap = false;  ///< that who enters a roundabout there has
  };

  static bool is_clear(const TrafficState& state, int junction);
  bool has_gap(const TrafficState& state, int approach) const;

  const LaneNetwork& network_;
  std::vector<Signal> signals_;  ///< of each junction
  std::vector<Arm> arms_;        ///< of each approach
};

}  // namespace infrasim
