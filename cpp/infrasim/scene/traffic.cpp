#include "infrasim/scene/traffic.h"

#include "infrasim/scene/driver.h"
#include "infrasim/scene/traffic_population.h"
#include "infrasim/scene/traffic_signals.h"
#include "infrasim/scene/traffic_state.h"

namespace infrasim {

class TrafficSteps::Impl {
 public:
  explicit Impl(const Site& site)
      : warm_up_s_(site.scene.traffic->warm_up_s),
        state_(site.network),
        signals_(site.network),
        population_(*site.scene.traffic, site.scene.seed, state_) {
    population_.fill();
  }

  std::vector<ObjectState> next() {
    if (started_) {
      step();
    } else {
      for (double t = 0; t < warm_up_s_; t += kRowStep_s) step();
      started_ = true;
    }
    return state_.object_states();
  }

 private:
  void step() {
    signals_.update(state_);
    choose_next_lanes(state_, signals_);
    signals_.find_gaps(state_);
    commit_at_green(state_, signals_);
    drive();
    move_between_lanes();
    population_.spawn();
  }

  /// Moves all vehicles. Accelerations are computed before any vehicle moves.
  void drive() {
    auto& lanes = state_.lanes;
    std::vector<std::vector<double>> accelerations(lanes.size());
    for (std::size_t lane = 0; lane < lanes.size(); ++lane)
      for (std::size_t i = 0; i < lanes[lane].size(); ++i)
        accelerations[lane].push_back(acceleration(state_, signals_, static_cast<int>(lane), i));
    for (std::size_t lane = 0; lane < lanes.size(); ++lane)
      for (std::size_t i = 0; i < lanes[lane].size(); ++i)
        advance(lanes[lane][i], accelerations[lane][i]);
  }

  void move_between_lanes() {
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

  double warm_up_s_;
  bool started_ = false;
  TrafficState state_;
  TrafficSignals signals_;
  TrafficPopulation population_;
};

TrafficSteps::TrafficSteps(const Site& site) : impl_(std::make_unique<Impl>(site)) {}
TrafficSteps::~TrafficSteps() = default;
TrafficSteps::TrafficSteps(TrafficSteps&&) noexcept = default;

std::vector<ObjectState> TrafficSteps::next() { return impl_->next(); }

void simulate_traffic(const Site& site, const StateSink& sink) {
  TrafficSteps steps(site);
  for (int k = 0; k <= row_steps(site.scene.duration_s); ++k) sink(steps.next());
}

Trajectories simulate_traffic(const Site& site) {
  Trajectories out;
  simulate_traffic(site, [&](const auto& states) { out.rows.push_back(states); });
  return out;
}

}  // namespace infrasim
