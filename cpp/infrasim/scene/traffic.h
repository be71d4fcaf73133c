#pragma once

#include "infrasim/scene/site.h"
#include "infrasim/scene/traffic_population.h"
#include "infrasim/scene/traffic_signals.h"
#include "infrasim/scene/traffic_state.h"

namespace infrasim {

/// Simulates vehicles on the lanes of a scene after a warm-up, with signals and the Intelligent
/// Driver Model (Treiber, Hennecke, Helbing 2000). The number of vehicles is constant and follows
/// from the density. When a vehicle leaves at the end of a lane, a new one appears at an entry.
/// Vehicles do not change lanes. Two points of each vehicle follow the lane, so that a long vehicle
/// stays within its lane in a bend. A vehicle that would leave its lane in a turn goes straight on.
class TrafficSteps {
 public:
  /// The constructor simulates nothing.
  /// @param site must outlive this object
  /// @throws ConfigError if vehicles of a class do not fit the lanes
  explicit TrafficSteps(const Site& site);
  TrafficSteps(const TrafficSteps&) = delete;
  TrafficSteps& operator=(const TrafficSteps&) = delete;

  /// Returns the vehicles at the next instant, which is 0.1 s after the previous one. States are
  /// rounded to the digits of the trajectory file. The first call also simulates the warm-up.
  std::vector<ObjectState> next();

 private:
  void step();
  void drive();
  void move_between_lanes();

  double warm_up_s_;
  bool started_ = false;
  TrafficState state_;
  TrafficSignals signals_;
  TrafficPopulation population_;
};

}  // namespace infrasim
