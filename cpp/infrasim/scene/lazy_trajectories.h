#pragma once

#include <cstddef>
#include <deque>
#include <exception>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "infrasim/scene/site.h"
#include "infrasim/scene/state_source.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// The objects of a scene. Traffic is simulated only up to the largest frame that was requested.
/// The frames equal the frames of a simulation of the whole scene. Thread-safe.
///
/// If there are too many states, the oldest rows are dropped. When a dropped row is requested, the
/// scene is simulated again from its beginning, and no more rows are dropped.
class LazyTrajectories {
 public:
  /// The constructor simulates nothing.
  /// @param late_s clock offset of the mount, as for resample_at_clock_offset
  /// @param most   maximum number of states in memory; if there are more, rows are dropped
  /// @throws the exceptions of StateSource and StateSteps
  explicit LazyTrajectories(std::shared_ptr<const Site> site, double late_s = 0,
                            std::size_t most = TrajectoryKeeper::kMostStates);
  LazyTrajectories(const LazyTrajectories&) = delete;
  LazyTrajectories& operator=(const LazyTrajectories&) = delete;

  int frames() const { return frames_; }
  bool pitched() const { return source_.pitched(); }

  /// Objects that exist for the whole of frame k, 0 to frames() - 1.
  /// @throws ConfigError if a vehicle hits a sensor up to that frame
  std::vector<MovingObject> in_frame(int k);

  /// Simulates the whole scene.
  /// @throws ConfigError if a vehicle hits a sensor
  void drive();

  /// Number of instants that have been simulated since the simulation last began.
  int simulated() const;
  /// Number of rows in memory.
  std::size_t kept() const;

 private:
  void restart();
  void advance();
  void advance_to(int row);
  void take(const std::vector<ObjectState>& states);

  const std::shared_ptr<const Site> site_;
  const StateSource source_;
  const double late_s_;
  const std::size_t most_;
  const int frames_;

  mutable std::mutex mutex_;
  std::optional<StateSteps> steps_;
  StateSink sink_;
  int instant_ = 0;  ///< number of the next instant to simulate
  std::exception_ptr error_;
  bool keeps_all_ = false;
  int first_ = 0;  ///< number of the first row in rows_
  std::size_t states_ = 0;
  std::deque<std::vector<ObjectState>> rows_;
};

}  // namespace infrasim
