#pragma once

#include <memory>

#include "infrasim/scene/site.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// Simulates vehicles on the lanes of a scene from a warm start, with signals and the Intelligent
/// Driver Model (Treiber, Hennecke, Helbing 2000). The number of vehicles follows the density: a
/// vehicle that leaves at the end of a lane is replaced by a new one at an entry. Vehicles keep
/// their lane. Two points of each vehicle follow the lane, so that long vehicles stay within it in
/// a bend. Vehicles that would not stay within a turn go straight on.
class TrafficSteps {
 public:
  /// Nothing is simulated yet.
  /// @param site must outlive this object
  /// @throws ConfigError if vehicles of a class do not fit the lanes
  explicit TrafficSteps(const Site& site);
  ~TrafficSteps();
  TrafficSteps(TrafficSteps&&) noexcept;

  /// The vehicles at the next instant, 0.1 s after the one before, rounded to the digits of the
  /// trajectory file. The first call simulates the warm-up too.
  std::vector<ObjectState> next();

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

/// Passes on the vehicles of each instant of a scene's duration.
/// @throws ConfigError if vehicles of a class do not fit the lanes
void simulate_traffic(const Site& site, const StateSink& sink);
/// As above, returning all rows at once.
Trajectories simulate_traffic(const Site& site);

}  // namespace infrasim
