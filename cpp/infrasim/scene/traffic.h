#pragma once

#include <memory>

#include "infrasim/scene/site.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// Simulates vehicles on the lanes of a scene after a warm-up, with signals and the Intelligent
/// Driver Model (Treiber, Hennecke, Helbing 2000). The number of vehicles is constant and follows
/// from the density. When a vehicle leaves at the end of a lane, a new one appears at an entry.
/// Vehicles do not change lanes. Two points of each vehicle follow the lane, so that a long vehicle
/// stays within its lane in a bend. A vehicle that would not stay within a turn goes straight on.
class TrafficSteps {
 public:
  /// The constructor simulates nothing.
  /// @param site must outlive this object
  /// @throws ConfigError if vehicles of a class do not fit the lanes
  explicit TrafficSteps(const Site& site);
  ~TrafficSteps();
  TrafficSteps(TrafficSteps&&) noexcept;

  /// Returns the vehicles at the next instant, which is 0.1 s after the previous one. States are
  /// rounded to the digits of the trajectory file. The first call also simulates the warm-up.
  std::vector<ObjectState> next();

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

/// Simulates the traffic for the scene's duration; passes the vehicles of each instant to `sink`.
/// @throws ConfigError if vehicles of a class do not fit the lanes
void simulate_traffic(const Site& site, const StateSink& sink);
/// Simulates the traffic for the scene's duration and returns the vehicles of all instants.
Trajectories simulate_traffic(const Site& site);

}  // namespace infrasim
