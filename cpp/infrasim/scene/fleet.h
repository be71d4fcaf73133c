#pragma once

#include <map>
#include <string>

#include "infrasim/core/classes.h"
#include "infrasim/core/rng.h"

namespace infrasim {

/// Of one vehicle, metres.
struct VehicleSize {
  double dx = 0, dy = 0, dz = 0;
};

/// The class that a uniform draw falls on; shares are weights by name, of which one is above 0.
const ObjectClass& class_at(const std::map<std::string, double>& shares, double u);

/// Draws 1 to 6 of a vehicle's numbers: normal, within two standard deviations.
VehicleSize draw_size(const ObjectClass& object_class, const Rng& rng);

}  // namespace infrasim
