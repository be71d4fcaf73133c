#pragma once

#include <cstdint>
#include <vector>

#include "infrasim/core/rng.h"
#include "infrasim/scene/traffic_state.h"

namespace infrasim {

/// Puts vehicles on the lanes and keeps their number constant.
class TrafficPopulation {
 public:
  /// @param state must outlive this object
  /// @throws ConfigError if vehicles of a class do not fit the lanes
  TrafficPopulation(const TrafficConfig& config, std::uint64_t seed, TrafficState& state);

  /// Distributes vehicles evenly over the lanes outside junctions. A vehicle starts further back if
  /// the vehicle ahead is long. A vehicle for which there is no space waits for an entry.
  void fill();
  /// Replaces a vehicle that has left the lanes by one that waits for an entry.
  void replace_one() { ++waiting_; }
  /// Puts waiting vehicles on entries where the nearest vehicle ahead leaves enough space.
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
  /// minimum radius of all lanes, metres, without turns at junctions and roundabouts
  double tightest_radius_ = kInf;
  double narrowest_m_ = kInf;  ///< width of the narrowest lane
  double density_carry_ = 0;
  std::size_t waiting_ = 0;
  std::uint64_t spawn_draws_ = 0;
  int next_id_ = 0;
};

}  // namespace infrasim
