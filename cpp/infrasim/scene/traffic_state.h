#pragma once

#include <deque>
#include <vector>

#include "infrasim/scene/lane_network.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// A simulated vehicle on a lane.
struct Vehicle {
  int id = 0;
  const ObjectClass* object_class = nullptr;
  double dx = 0, dy = 0, dz = 0;
  double desired_speed = 0;
  double lateral = 0;      ///< offset to the left of the lane's centre
  double turn_choice = 0;  ///< uniform sample that selects the turn at a junction
  int lane = 0;
  int last_lane = -1;
  int next_lane = -1;
  double s = 0;
  double speed = 0;
  bool committed = false;  ///< whether the vehicle can no longer stop at its signal
};

/// Returns half the distance between the two points of a vehicle that follow its path. With this
/// distance, the vehicle's side extends as far inwards in a bend as its corners extend outwards.
double half_base(const Vehicle& v);

/// Returns how far a vehicle extends beside its path in a bend. The vehicle drives `outwards`
/// metres outside the path.
double half_width_in_bend(const Vehicle& v, double radius, double outwards);

/// The vehicles on the lanes of a network.
struct TrafficState {
  const LaneNetwork& network;
  std::vector<std::deque<Vehicle>> lanes;  ///< vehicles of each lane, in order from the front
  /// sorted indices of the lanes that are inside each junction, lead to it or leave it
  std::vector<std::vector<int>> near;

  explicit TrafficState(const LaneNetwork& network);

  const Lane& lane_of(const Vehicle& v) const { return network.lanes[v.lane]; }
  bool is_on_ring(const Lane& lane) const {
    return lane.junction >= 0 && network.rings[lane.junction];
  }
  double to_stop_line(const Vehicle& v) const { return lane_of(v).curve.length() - v.s - v.dx / 2; }
  Vec2 position(const Vehicle& v) const { return lane_of(v).curve.at(v.s).position; }
  /// Returns whether a vehicle in a roundabout is on the ring or is entering the ring. A vehicle
  /// that is leaving the ring does not count.
  bool stays_on(const Ring& ring, const Vehicle& v) const {
    return ring.holds(position(v)) || v.s < lane_of(v).curve.length() / 2;
  }

  /// Calls `use` for each vehicle that is entering the ring of a junction or is on it, but not for
  /// vehicles that are leaving it. Does nothing if the junction has no ring.
  template <class Use>
  void for_each_on_ring(int junction, const Use& use) const {
    if (junction < 0 || !network.rings[junction]) return;
    const Ring& ring = *network.rings[junction];
    for (const int i : near[junction])
      if (network.lanes[i].junction == junction)
        for (const Vehicle& v : lanes[i])
          if (stays_on(ring, v)) use(ring, v);
  }

  /// Returns the states of all vehicles by increasing id, rounded to the digits of the trajectory
  /// file.
  std::vector<ObjectState> object_states() const;

 private:
  Vec2 on_path(const Vehicle& v, double s) const;
  ObjectState object_state(const Vehicle& v) const;
};

}  // namespace infrasim
