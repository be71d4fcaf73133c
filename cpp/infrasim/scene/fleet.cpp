#include "infrasim/scene/fleet.h"

#include <algorithm>

namespace infrasim {

const ObjectClass& class_at(const std::map<std::string, double>& shares, double u) {
  double sum = 0;
  for (const auto& [name, share] : shares) sum += share;
  for (const auto& [name, share] : shares) {
    u -= share / sum;
    if (u < 0) return *find_class(name);
  }
  return *find_class(shares.rbegin()->first);
}

VehicleSize sample_size(const ObjectClass& object_class, const Rng& rng) {
  const auto size = [&](const Spread& spread, unsigned j) {
    return spread.mean + spread.std * std::clamp(rng.normal(j), -2.0, 2.0);
  };
  return {size(object_class.length_m, 1), size(object_class.width_m, 3),
          size(object_class.height_m, 5)};
}

}  // namespace infrasim
