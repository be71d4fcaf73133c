#pragma once

#include "infrasim/scene/site.h"

namespace infrasim {

/// @throws ConfigError for a barrier, box, plant, parked vehicle or row of pedestrians or cyclists
///   on a lane, and for vehicles, pedestrians or cyclists that overlap with another object
void check_obstacles(const Site& site);

}  // namespace infrasim
