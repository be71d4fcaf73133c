#include "infrasim/scene/traffic_signals.h"

namespace infrasim {

namespace {

// s, minimum time between a vehicle that enters a roundabout and the next vehicle on the ring
constexpr double kRingGap = 5;

}  // namespace

TrafficSignals::TrafficSignals(const LaneNetwork& network)
    : network_(network),
      signals_(network.junctions.size()),
      arms_(network.approach_junctions.size()) {
  for (std::size_t a = 0; a < network.approach_junctions.size(); ++a)
    signals_[network.approach_junctions[a]].approaches.push_back(static_cast<int>(a));
  for (std::size_t i = 0; i < network.lanes.size(); ++i)
    if (const int approach = network.lanes[i].approach; approach >= 0)
      arms_[approach].lanes.push_back(static_cast<int>(i));
}

void TrafficSignals::update(const TrafficState& state) {
  for (std::size_t j = 0; j < signals_.size(); ++j) {
    if (network_.rings[j]) continue;
    Signal& signal = signals_[j];
    const SignalConfig timing = network_.junctions[j].signal.value_or(SignalConfig{});
    signal.since += kRowStep_s;
    if (signal.green && signal.since >= timing.green_s) {
      signal.green = false;
      signal.since = 0;
    } else if (!signal.green && signal.since >= timing.all_red_s &&
               is_clear(state, static_cast<int>(j))) {
      signal.green = true;
      signal.since = 0;
      signal.current = (signal.current + 1) % signal.approaches.size();
    }
  }
}

void TrafficSignals::find_gaps(const TrafficState& state) {
  for (std::size_t a = 0; a < arms_.size(); ++a)
    if (network_.rings[network_.approach_junctions[a]])
      arms_[a].gap = has_gap(state, static_cast<int>(a));
}

bool TrafficSignals::is_green(int approach) const {
  if (network_.rings[network_.approach_junctions[approach]]) return arms_[approach].gap;
  const Signal& signal = signals_[network_.approach_junctions[approach]];
  return signal.green && signal.approaches[signal.current] == approach;
}

/// Returns whether a vehicle may enter a roundabout. The vehicle must give way to vehicles that
/// would have to brake, but not to vehicles that entered earlier from the same arm.
bool TrafficSignals::has_gap(const TrafficState& state, int approach) const {
  const Curve& lane = network_.lanes[arms_[approach].lanes.front()].curve;
  const Vec2 end = lane.at(lane.length()).position;
  bool free = true;
  state.for_each_on_ring(
      network_.approach_junctions[approach], [&](const Ring& ring, const Vehicle& v) {
        const Vec2 entry = ring.entry(end);
        const bool ahead = network_.lanes[v.last_lane].approach == approach;
        const double away = ring.along(state.position(v), entry) - v.dx / 2;
        free = free && (ahead || away > kRingGap * state.lane_of(v).speed_limit_m_s);
      });
  return free;
}

/// Returns whether a junction is empty. A junction is not empty if a vehicle is inside, is about to
/// enter, or is leaving with its tail still inside.
bool TrafficSignals::is_clear(const TrafficState& state, int junction) {
  for (const int i : state.near[junction]) {
    const Lane& lane = state.network.lanes[i];
    for (const Vehicle& v : state.lanes[i]) {
      if (lane.junction == junction || (lane.approach >= 0 && v.committed)) return false;
      if (lane.leaves == junction && v.s < v.dx / 2 + 1) return false;
    }
  }
  return true;
}

}  // namespace infrasim
