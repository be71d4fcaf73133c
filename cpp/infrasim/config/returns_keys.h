#pragma once

#include <string>

#include "infrasim/config/lidar_config.h"

// Keys of returns. Fields is FieldReader, FieldWriter or FieldLister.

namespace infrasim {

/// Visits the keys of `returns` of a unit.
template <class Fields>
void visit(Fields& f, ReturnsConfig& c);

/// Describes a mode that the sensor does not offer; empty if it does.
std::string unoffered_mode(const EchoesConfig& echoes);

}  // namespace infrasim
