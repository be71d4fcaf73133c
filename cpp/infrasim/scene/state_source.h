#pragma once

#include <optional>
#include <vector>

#include "infrasim/scene/people.h"
#include "infrasim/scene/site.h"
#include "infrasim/scene/traffic.h"
#include "infrasim/scene/trajectories.h"
#include "infrasim/scene/trajectory_text.h"

namespace infrasim {

class StateSteps;

/// Provides the vehicles, pedestrians and cyclists of a scene, one instant after the other.
/// Simulated states are not stored. A trajectory file is read once.
class StateSource {
 public:
  /// @param site must outlive this object
  /// @throws ConfigError, IoError if the trajectory file has an error or can't be read
  explicit StateSource(const Site& site);

  /// Returns the objects that stand during the whole scene, by increasing id: recorded vehicles,
  /// parked vehicles and standing people.
  const std::vector<ObjectState>& standing() const { return standing_; }
  /// Returns whether objects may have a pitch. Their tables then have a column for the pitch.
  bool pitched() const { return site_.scene.profile || (recorded_ && recorded_->pitched); }
  /// Passes the states of all instants to `sink`, with the standing objects.
  void each(const StateSink& sink) const;

 private:
  friend class StateSteps;
  const Site& site_;
  std::optional<Trajectories> recorded_;
  std::vector<ObjectState> standing_;
};

/// Computes the states of a source instant by instant, on request.
class StateSteps {
 public:
  /// @param source must outlive this object
  /// @throws ConfigError if vehicles of a class do not fit the lanes, or people do not fit a road
  explicit StateSteps(const StateSource& source);

  /// Returns the states of the next instant, by increasing id, without the source's standing
  /// objects.
  std::vector<ObjectState> next_moving();

 private:
  const StateSource& source_;
  std::optional<TrafficSteps> traffic_;
  People people_;
  int instant_ = 0;
};

}  // namespace infrasim
