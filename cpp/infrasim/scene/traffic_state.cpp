#include "infrasim/scene/traffic_state.h"

#include <algorithm>
#include <cmath>

#include "infrasim/core/math.h"

namespace infrasim {

namespace {

/// Returns the junction that contains a lane, or at which the lane ends or starts; -1 if there is
/// none.
int junction_near(const LaneNetwork& network, const Lane& lane) {
  if (lane.approach >= 0) return network.approach_junctions[lane.approach];
  return std::max(lane.junction, lane.leaves);
}

}  // namespace

double half_base(const Vehicle& v) { return v.dx / std::sqrt(8.0); }

double half_width_in_bend(const Vehicle& v, double radius, double outwards) {
  if (std::isinf(radius)) return v.dy / 2 + std::abs(outwards);
  const double a = std::min(half_base(v), radius);
  const double middle = std::sqrt(radius * radius - a * a) + outwards;
  return std::max(math::hypot(middle + v.dy / 2, v.dx / 2) - radius, radius - middle + v.dy / 2);
}

TrafficState::TrafficState(const LaneNetwork& lane_network)
    : network(lane_network), lanes(network.lanes.size()), near(network.junctions.size()) {
  for (std::size_t i = 0; i < network.lanes.size(); ++i)
    if (const int junction = junction_near(network, network.lanes[i]); junction >= 0)
      near[junction].push_back(static_cast<int>(i));
}

/// Returns the position on a vehicle's path at a station of its lane, possibly beyond the lane's
/// ends.
Vec2 TrafficState::on_path(const Vehicle& v, double s) const {
  const Lane& lane = lane_of(v);
  const double length = lane.curve.length();
  const int next = v.next_lane < 0 && lane.next.size() == 1 ? lane.next.front() : v.next_lane;
  if (s > length && next >= 0) return network.lanes[next].curve.at(s - length).position;
  if (s >= 0 || v.last_lane < 0) return lane.curve.at(s).position;
  const Curve& before = network.lanes[v.last_lane].curve;
  return before.at(before.length() + s).position;
}

ObjectState TrafficState::object_state(const Vehicle& v) const {
  const Vec2 rear = on_path(v, v.s - half_base(v)), front = on_path(v, v.s + half_base(v));
  const double heading = math::atan2(front.y - rear.y, front.x - rear.x);
  const Vec2 xy = 0.5 * (rear + front) + v.lateral * heading_vector(heading + kPi / 2);
  return rounded({v.id,
                  v.object_class->id,
                  {xy.x, xy.y, lane_of(v).elevation_m + v.dz / 2, v.dx, v.dy, v.dz, heading},
                  v.speed});
}

std::vector<ObjectState> TrafficState::object_states() const {
  std::vector<ObjectState> row;
  for (const auto& lane : lanes)
    for (const Vehicle& v : lane) row.push_back(object_state(v));
  std::ranges::sort(row, {}, &ObjectState::id);
  return row;
}

}  // namespace infrasim
