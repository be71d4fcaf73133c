#pragma once

#include <string>

#include "infrasim/config/lidar_config.h"

// Keys of returns. Fields is FieldReader, FieldWriter or FieldLister.

namespace infrasim {

/// Visits the keys of `returns` of a unit.
template <class Fields>
void visit(Fields& f, ReturnsConfig& c);

/// Returns the error text for an echo mode that the sensor does not offer. The text is empty if the
/// sensor offers the mode.
std::string unoffered_mode(const EchoesConfig& echoes);

}  // namespace infrasim
