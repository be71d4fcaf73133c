#pragma once

#include "infrasim/config/lidar_config.h"

// Keys of scan patterns. Fields is FieldReader, FieldWriter or FieldLister.

namespace infrasim {

// A frame is a tenth of a second: at least one ray, and no more than memory holds.
inline constexpr double kFewestPerSecond = 10;
inline constexpr double kMostRaysPerSecond = 1e8;

/// `pattern` of a unit.
template <class Fields>
void visit(Fields& f, PatternConfig& c);

}  // namespace infrasim
