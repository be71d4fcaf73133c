#pragma once

#include <cstddef>
#include <deque>
#include <exception>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <vector>

#include "infrasim/scene/site.h"
#include "infrasim/scene/state_source.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// The objects of a scene. Traffic is simulated only up to the latest frame that was requested. The
/// objects equal those of a simulation of the whole scene. Thread-safe.
///
/// If there are more states than the maximum, the oldest rows are dropped. Rows that were requested
/// before are kept, up to the same number of states. When a dropped row is requested, the scene is
/// simulated again from its beginning, and no more rows are dropped.
class LazyTrajectories {
 public:
  /// The constructor simulates nothing.
  /// @param most   maximum number of states in memory; if there are more, rows are dropped
  /// @throws the exceptions of StateSource and StateSteps
  explicit LazyTrajectories(std::shared_ptr<const Site> site,
                            std::size_t most = TrajectoryKeeper::kMostStates);
  LazyTrajectories(const LazyTrajectories&) = delete;
  LazyTrajectories& operator=(const LazyTrajectories&) = delete;

  int steps() const { return steps_count_; }
  bool pitched() const { return source_.pitched(); }

  /// Returns the objects that exist from row number `from` to row number `to`. Both may be
  /// fractional, as in Trajectories::between.
  /// @throws ConfigError if a vehicle hits a sensor up to the row `to`
  std::vector<MovingObject> between(double from, double to);

  /// Simulates the whole scene.
  /// @throws ConfigError if a vehicle hits a sensor
  void drive();

  /// Returns the number of instants that have been simulated since the simulation last began.
  int simulated() const;
  /// Returns the number of rows in memory.
  std::size_t kept() const;

 private:
  bool has(int row) const;
  const std::vector<ObjectState>& row(int k) const;
  void restart();
  void drop_first();
  void advance();
  void advance_to(int row);

  const std::shared_ptr<const Site> site_;
  const StateSource source_;
  const std::size_t most_;
  const int steps_count_;

  mutable std::mutex mutex_;
  std::optional<StateSteps> steps_;
  int instant_ = 0;  ///< number of the next instant to simulate
  std::exception_ptr error_;
  bool keeps_all_ = false;
  int first_ = 0;  ///< number of the first row in rows_
  std::size_t states_ = 0;
  std::deque<std::vector<ObjectState>> rows_;
  std::set<int> requested_;  ///< numbers of requested rows that are not dropped yet
  /// requested rows that were dropped from rows_
  std::map<int, std::vector<ObjectState>> kept_;
  std::size_t kept_states_ = 0;
};

}  // namespace infrasim
