#pragma once

#include <string>

#include "infrasim/config/lidar_config.h"

// Functions that visit the keys of a return model. The template parameter Fields is FieldReader,
// FieldWriter or FieldLister.

namespace infrasim {

/// Visits the keys of a LiDAR unit's `returns`.
template <class Fields>
void visit(Fields& f, ReturnsConfig& c);

/// Returns the error text for an echo mode that the sensor does not offer. The text is empty if the
/// sensor offers the mode.
std::string unoffered_mode(const EchoesConfig& echoes);

}  // namespace infrasim
