#include "infrasim/scene/driver.h"

#include <algorithm>
#include <cmath>

namespace infrasim {

namespace {

constexpr double kAcceleration = 1.5;    // m/s2, maximum (Treiber, Kesting 2013, table 11.2)
constexpr double kHardestBraking = 8.0;  // m/s2, maximum braking
// m/s2; a vehicle does not stop at a red signal if it would have to brake harder
constexpr double kCommitBraking = 3.0;
// m; minimum distance over which a driver looks ahead; a fast driver looks ahead over the distance
// of a comfortable stop
constexpr double kLookahead = 100;
// m; distance into a junction beyond which the tail of a turning vehicle no longer blocks the lane
constexpr double kTailClear = 10;

/// The object that limits a driver: the free distance between the front bumper and the object, and
/// the speed of the object.
struct Leader {
  double gap = kInf;
  double speed = 0;
};

double lookahead(double speed) { return std::max(kLookahead, speed * speed / (2 * kBraking)); }

double idm_acceleration(double speed, double desired, const Leader& leader) {
  const double ratio = speed / desired;
  double acceleration = 1 - ratio * ratio * ratio * ratio;
  if (leader.gap < lookahead(speed)) {
    const double closing =
        speed * (speed - leader.speed) / (2 * std::sqrt(kAcceleration * kBraking));
    const double wanted = kStandstillGap_m + std::max(0.0, speed * kTimeGap + closing);
    const double squeeze = wanted / std::max(leader.gap, 0.1);
    acceleration -= squeeze * squeeze;
  }
  return std::clamp(kAcceleration * acceleration, -kHardestBraking, kAcceleration);
}

/// Returns whether a turning vehicle stays within its lane, so that the neighbouring lanes are
/// free.
bool stays_in_lane(const Vehicle& v, const Lane& turn) {
  const double outwards = turn.turn == Turn::kRight ? v.lateral : -v.lateral;
  return half_width_in_bend(v, turn.curve.tightest_radius(), outwards) <= turn.width_m / 2;
}

/// Returns the lane that a vehicle takes at the end of its own lane.
int next_lane(const TrafficState& state, const TrafficSignals& signals, const Vehicle& v) {
  const LaneNetwork& network = state.network;
  const Lane& lane = state.lane_of(v);
  if (lane.next.size() == 1) return lane.next.front();
  const JunctionConfig& junction = network.junctions[network.approach_junctions[lane.approach]];
  const auto way = [&](Turn turn) {
    return std::ranges::find(lane.next, turn, [&](int next) { return network.lanes[next].turn; });
  };
  if (way(Turn::kStraight) == lane.next.end()) {  // the lane ends at a T junction
    const double shares = junction.left_share + junction.right_share;
    const double left = shares > 0 ? junction.left_share / shares : 0.5;
    const bool goes_left = v.turn_choice < left;
    const int wanted = *way(goes_left ? Turn::kLeft : Turn::kRight);
    const int other = *way(goes_left ? Turn::kRight : Turn::kLeft);
    const bool only_other =
        !stays_in_lane(v, network.lanes[wanted]) && stays_in_lane(v, network.lanes[other]);
    return only_other ? other : wanted;
  }
  for (const int next : lane.next) {
    const Turn turn = network.lanes[next].turn;
    // Vehicles turn from one lane of an approach only, so the share of turning vehicles on that
    // lane is larger.
    const auto lanes = static_cast<double>(signals.lanes_of(lane.approach));
    if (!stays_in_lane(v, network.lanes[next])) continue;
    if (turn == Turn::kLeft && v.turn_choice < junction.left_share * lanes) return next;
    if (turn == Turn::kRight && v.turn_choice > 1 - junction.right_share * lanes) return next;
  }
  return *way(Turn::kStraight);
}

/// Returns the desired speed, reduced if the vehicle must brake for a next lane with a lower speed
/// limit.
double target_speed(const TrafficState& state, const Vehicle& v) {
  const double here = std::min(v.desired_speed, state.lane_of(v).speed_limit_m_s);
  if (v.next_lane < 0) return here;
  const double limit = state.network.lanes[v.next_lane].speed_limit_m_s;
  const double distance = std::max(0.0, state.to_stop_line(v));
  return std::min(here, std::sqrt(limit * limit + 2 * kBraking / 2 * distance));
}

/// Returns the gap and the speed of the nearest vehicle ahead of vehicle i.
Leader vehicle_ahead(const TrafficState& state, int lane, std::size_t i) {
  const LaneNetwork& network = state.network;
  const auto& lanes = state.lanes;
  const Vehicle& v = lanes[lane][i];
  Leader best;
  const auto consider = [&](const Vehicle& other, double distance) {
    const double gap = distance - (v.dx + other.dx) / 2;
    if (gap < best.gap) best = {gap, other.speed};
  };
  if (i > 0) consider(lanes[lane][i - 1], lanes[lane][i - 1].s - v.s);
  double to_end = network.lanes[lane].curve.length() - v.s;
  // Tails of vehicles that have just turned off still block the lane.
  for (const int next : network.lanes[lane].next)
    for (const Vehicle& other : lanes[next])
      if (other.s - other.dx / 2 < kTailClear) consider(other, to_end + other.s);
  state.for_each_on_ring(network.lanes[lane].junction, [&](const Ring& ring, const Vehicle& other) {
    const double ahead = ring.along(state.position(v), state.position(other));
    if (other.id != v.id && state.stays_on(ring, v) && ahead < ring.config.radius_m)
      consider(other, ahead);
  });
  for (int next = v.next_lane; next >= 0 && to_end < lookahead(v.speed);) {
    if (!lanes[next].empty()) {
      consider(lanes[next].back(), to_end + lanes[next].back().s);
      break;
    }
    to_end += network.lanes[next].curve.length();
    next = network.lanes[next].next.empty() ? -1 : network.lanes[next].next.front();
  }
  return best;
}

/// Returns the red signal ahead as a vehicle that stands slightly behind the stop line. Returns an
/// infinite gap if the driver need not stop.
Leader red_signal(const TrafficState& state, const TrafficSignals& signals, const Vehicle& v) {
  const int approach = state.lane_of(v).approach;
  if (approach < 0 || v.committed || signals.is_green(approach)) return {};
  return {state.to_stop_line(v) + kStandstillGap_m - 0.5, 0};
}

}  // namespace

void choose_next_lanes(TrafficState& state, const TrafficSignals& signals) {
  for (auto& lane : state.lanes)
    for (Vehicle& v : lane)
      if (v.next_lane < 0 && !state.lane_of(v).next.empty())
        v.next_lane = next_lane(state, signals, v);
}

void commit_at_green(TrafficState& state, const TrafficSignals& signals) {
  for (auto& lane : state.lanes)
    for (Vehicle& v : lane) {
      const int approach = state.lane_of(v).approach;
      if (v.committed || approach < 0 || !signals.is_green(approach)) continue;
      const double gap = state.to_stop_line(v);
      v.committed = !(gap > 0 && v.speed * v.speed / (2 * gap) < kCommitBraking);
    }
}

double acceleration(const TrafficState& state, const TrafficSignals& signals, int lane,
                    std::size_t i) {
  const Vehicle& v = state.lanes[lane][i];
  Leader leader = vehicle_ahead(state, lane, i);
  const Leader signal = red_signal(state, signals, v);
  if (signal.gap < leader.gap) leader = signal;
  return idm_acceleration(v.speed, target_speed(state, v), leader);
}

void advance(Vehicle& v, double acceleration) {
  const double speed = std::max(0.0, v.speed + acceleration * kRowStep_s);
  v.s += (v.speed + speed) / 2 * kRowStep_s;
  v.speed = speed;
}

}  // namespace infrasim
