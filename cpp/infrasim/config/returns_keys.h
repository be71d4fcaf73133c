#pragma once

#include "infrasim/config/lidar_config.h"

// Keys of returns. Fields is FieldReader, FieldWriter or FieldLister.

namespace infrasim {

/// Visits the keys of `returns` of a unit.
template <class Fields>
void visit(Fields& f, ReturnsConfig& c);

}  // namespace infrasim
