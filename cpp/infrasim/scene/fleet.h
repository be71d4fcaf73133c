#pragma once

#include <map>
#include <string>

#include "infrasim/core/classes.h"
#include "infrasim/core/rng.h"

namespace infrasim {

/// Size of one vehicle, metres.
struct VehicleSize {
  double dx = 0, dy = 0, dz = 0;
};

/// Returns the object class that a uniform sample u selects. `shares` are weights by class name; at
/// least one weight is above 0.
const ObjectClass& class_at(const std::map<std::string, double>& shares, double u);

/// Returns a random size within two standard deviations, from samples 1 to 6 of a vehicle's random
/// stream.
VehicleSize sample_size(const ObjectClass& object_class, const Rng& rng);

}  // namespace infrasim
