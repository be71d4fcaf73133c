#pragma once

#include "infrasim/scene/site.h"

namespace infrasim {

/// @throws ConfigError for a barrier, box, plant, parked vehicle or row of people on a lane, or for
/// vehicles and people where something else stands
void check_obstacles(const Site& site);

}  // namespace infrasim
