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
  double lateral = 0;      ///< of the driver from the lane's centre
  double turn_choice = 0;  ///< uniform sample
  int lane = 0;
  int last_lane = -1;
  int next_lane = -1;
  double s = 0;
  double speed = 0;
  bool committed = false;  ///< past the point where it could still stop at its signal
};

/// Half the length between the two points of a vehicle that follow its path. So far apart, a
/// vehicle in a bend extends as far inwards with its side as outwards with its corners.
double half_base(const Vehicle& v);

/// How far a vehicle extends beside its path in a bend, driving `outwards` metres outside of it.
double half_width_in_bend(const Vehicle& v, double radius, double outwards);

/// Who is where on the lanes of a network.
struct TrafficState {
  const LaneNetwork& network;
  std::vector<std::deque<Vehicle>> lanes;  ///< vehicles of each lane, the one furthest ahead first
  std::vector<std::vector<int>> near;      ///< lanes in, to and from each junction, in their order

  explicit TrafficState(const LaneNetwork& network);

  const Lane& lane_of(const Vehicle& v) const { return network.lanes[v.lane]; }
  bool is_on_ring(const Lane& lane) const {
    return lane.junction >= 0 && network.rings[lane.junction];
  }
  double to_stop_line(const Vehicle& v) const { return lane_of(v).curve.length() - v.s - v.dx / 2; }
  Vec2 position(const Vehicle& v) const { return lane_of(v).curve.at(v.s).position; }
  /// Whether a vehicle of a roundabout enters its ring or is on it, and does not leave it.
  bool stays_on(const Ring& ring, const Vehicle& v) const {
    return ring.holds(position(v)) || v.s < lane_of(v).curve.length() / 2;
  }

  /// Each vehicle that enters or is on the ring of a junction, if that has one; not who leaves it.
  template <class Use>
  void for_each_on_ring(int junction, const Use& use) const {
    if (junction < 0 || !network.rings[junction]) return;
    const Ring& ring = *network.rings[junction];
    for (const int i : near[junction])
      if (network.lanes[i].junction == junction)
        for (const Vehicle& v : lanes[i])
          if (stays_on(ring, v)) use(ring, v);
  }

  /// By increasing id, rounded to the digits of the trajectory file.
  std::vector<ObjectState> object_states() const;

 private:
  Vec2 on_path(const Vehicle& v, double s) const;
  ObjectState object_state(const Vehicle& v) const;
};

}  // namespace infrasim
