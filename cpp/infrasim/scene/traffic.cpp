#include "infrasim/scene/traffic.h"

#include "infrasim/scene/driver.h"

namespace infrasim {

TrafficSteps::TrafficSteps(const Site& site)
    : warm_up_s_(site.scene.traffic->warm_up_s),
      state_(site.network),
      signals_(site.network),
      population_(*site.scene.traffic, site.scene.seed, state_) {
  population_.fill();
}

std::vector<ObjectState> TrafficSteps::next() {
  if (started_) {
    step();
  } else {
    for (double t = 0; t < warm_up_s_; t += kRowStep_s) step();
    started_ = true;
  }
  return state_.object_states();
}

void TrafficSteps::step() {
  signals_.update(state_);
  choose_next_lanes(state_, signals_);
  signals_.find_gaps(state_);
  commit_at_green(state_, signals_);
  drive();
  move_between_lanes();
  population_.spawn();
}

/// Moves all vehicles. Accelerations are computed before any vehicle moves.
void TrafficSteps::drive() {
  auto& lanes = state_.lanes;
  std::vector<std::vector<double>> accelerations(lanes.size());
  for (std::size_t lane = 0; lane < lanes.size(); ++lane)
    for (std::size_t i = 0; i < lanes[lane].size(); ++i)
      accelerations[lane].push_back(acceleration(state_, signals_, static_cast<int>(lane), i));
  for (std::size_t lane = 0; lane < lanes.size(); ++lane)
    for (std::size_t i = 0; i < lanes[lane].size(); ++i)
      advance(lanes[lane][i], accelerations[lane][i]);
}

void TrafficSteps::move_between_lanes() {
  for (std::size_t i = 0; i < state_.lanes.size(); ++i)
    while (!state_.lanes[i].empty()) {
      Vehicle v = state_.lanes[i].front();
      const Lane& lane = state_.network.lanes[i];
      const double length = lane.curve.length();
      const bool leaves = lane.next.empty();
      if (v.s < length - (leaves ? v.dx / 2 : 0)) break;
      state_.lanes[i].pop_front();
      if (leaves) {
        population_.replace_one();
        continue;
      }
      v.s -= length;
      v.last_lane = v.lane;
      v.lane = v.next_lane;
      v.next_lane = -1;
      if (state_.lane_of(v).junction < 0) v.committed = false;
      state_.lanes[v.lane].push_back(v);
    }
}

}  // namespace infrasim
