#pragma once

#include <string>

#include "infrasim/config/fields.h"
#include "infrasim/config/key_list.h"
#include "infrasim/config/lidar_config.h"

// Functions that visit the keys of a LiDAR file: each function passes keys and their values to a
// Fields object. Fields is FieldReader, which reads the values, FieldWriter, which writes them, or
// FieldLister, which lists the keys.

namespace infrasim {

// Limits of the number of rays per second. A frame must have at least one ray, and its rays must
// fit into memory.
inline constexpr double kFewestPerSecond = 1 / kShortestPeriod_s;
inline constexpr double kMostRaysPerSecond = 1e8;

/// Visits the keys of a LiDAR unit's `pattern`.
template <class Fields>
void visit(Fields& f, PatternConfig& c);

/// Visits the keys of a LiDAR unit's `returns`.
template <class Fields>
void visit(Fields& f, ReturnsConfig& c);

/// Returns the error text for an echo mode that the sensor does not offer. The text is empty if the
/// sensor offers the mode.
std::string unoffered_mode(const EchoesConfig& echoes);

}  // namespace infrasim
