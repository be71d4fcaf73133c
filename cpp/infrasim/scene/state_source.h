#pragma once

#include <optional>

#include "infrasim/scene/site.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// The vehicles and people of a scene, one instant after the other; simulated ones are not kept,
/// those of a file are read once.
class StateSource {
 public:
  /// @param site outlives this
  /// @throws ConfigError, IoError for the file of trajectories
  explicit StateSource(const Site& site);

  /// Whether vehicles may lean forwards or backwards: tables have the column.
  bool pitched() const { return site_.scene.profile || (recorded_ && recorded_->pitched); }
  void each(const StateSink& sink) const;
  /// The same up to a number of instants.
  void each(const StateSink& sink, int instants) const;

 private:
  const Site& site_;
  std::optional<Trajectories> recorded_;
};

}  // namespace infrasim
