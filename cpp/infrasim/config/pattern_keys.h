#pragma once

#include "infrasim/config/lidar_config.h"

// Keys of scan patterns. Fields is FieldReader, FieldWriter or FieldLister.

namespace infrasim {

// Limits of the number of rays per second. A frame must have at least one ray, and its rays must
// fit into memory.
inline constexpr double kFewestPerSecond = 1 / kShortestPeriod_s;
inline constexpr double kMostRaysPerSecond = 1e8;

/// Visits the keys of `pattern` of a unit.
template <class Fields>
void visit(Fields& f, PatternConfig& c);

}  // namespace infrasim
