#pragma once

#include <optional>

#include "infrasim/scene/site.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// The vehicles, pedestrians and cyclists of a scene, one instant after the other. Simulated states
/// are not kept; a file is read once.
class StateSource {
 public:
  /// @param site must outlive this object
  /// @throws ConfigError, IoError for the file of trajectories
  explicit StateSource(const Site& site);

  /// Whether objects may have a pitch: their tables have the column.
  bool pitched() const { return site_.scene.profile || (recorded_ && recorded_->pitched); }
  void each(const StateSink& sink) const;
  /// As above, up to a number of instants.
  void each(const StateSink& sink, int instants) const;

 private:
  const Site& site_;
  std::optional<Trajectories> recorded_;
};

}  // namespace infrasim
