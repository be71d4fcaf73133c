#pragma once

#include "infrasim/config/lidar_config.h"

// Functions that visit the keys of scan patterns. The template parameter Fields is FieldReader,
// FieldWriter or FieldLister.

namespace infrasim {

// Limits of the number of rays per second. A frame must have at least one ray, and its rays must
// fit into memory.
inline constexpr double kFewestPerSecond = 1 / kShortestPeriod_s;
inline constexpr double kMostRaysPerSecond = 1e8;

/// Visits the keys of a LiDAR unit's `pattern`.
template <class Fields>
void visit(Fields& f, PatternConfig& c);

}  // namespace infrasim
