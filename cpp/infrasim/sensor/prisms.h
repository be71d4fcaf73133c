#pragma once

#include <utility>
#include <vector>

#include "infrasim/config/lidar_config.h"

namespace infrasim {

/// Directions of all lasers that fire at the same time, one column per component, so that loops
/// over them can be vectorised.
struct DirectionBatch {
  std::vector<double> x, y, z;
};

/// Computes the directions of all lasers behind the prisms at one time.
/// @param tilts cosine and sine of the wedge angle of each prism
/// @throws ConfigError for total reflection
void trace(const std::vector<PrismConfig>& prisms,
           const std::vector<std::pair<double, double>>& tilts, const DirectionBatch& lasers,
           double time_s, DirectionBatch& directions);

}  // namespace infrasim
