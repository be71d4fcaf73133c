#pragma once

#include <cstdint>
#include <vector>

#include "infrasim/core/rng.h"
#include "infrasim/scene/traffic_state.h"

namespace infrasim {

/// Puts vehicles on the lanes and holds their number at the density.
class TrafficPopulation {
 public:
  /// @param state outlives this
  /// @throws ConfigError for vehicles of a class that do not fit the lanes
  TrafficPopulation(const TrafficConfig& config, std::uint64_t seed, TrafficState& state);

  /// Vehicles over the lanes outside junctions, evenly at the density, but for those that stand
  /// further back for the length of who is ahead; who has no room waits for an entry.
  void fill();
  /// A vehicle left the lanes: another one waits for an entry.
  void replace_one() { ++waiting_; }
  /// Puts the vehicles that wait for an entry where the last one ahead leaves room.
  void spawn();

 private:
  double speed_at_start(const Vehicle& v, double desired) const;
  Vehicle new_vehicle(int lane);
  void check_fits(const ObjectClass& row) const;
  void fit_lanes(Vehicle& v) const;

  const TrafficConfig& config_;
  TrafficState& state_;
  Rng rng_;
  std::vector<int> entries_;
  double tightest_radius_ = kInf;  ///< m, of the lanes, turns at junctions left out
  double narrowest_m_ = kInf;      ///< width of a lane
  double density_carry_ = 0;
  std::size_t waiting_ = 0;
  std::uint64_t spawn_draws_ = 0;
  int next_id_ = 0;
};

}  // namespace infrasim
