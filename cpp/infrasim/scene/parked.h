#pragma once

#include <span>
#include <vector>

#include "infrasim/config/scene_config.h"
#include "infrasim/scene/curve.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// smallest id of parked vehicles, larger than the ids of traffic
inline constexpr int kFirstParkedId = 1'000'000'000;

/// A vehicle parked for the whole run.
struct ParkedVehicle {
  ObjectState state;
  std::size_t row = 0;  ///< index of its entry in the list `parked` of the scene
};

/// Returns all parked vehicles of a scene by increasing id, sampled from the scene's seed. Each row
/// is filled from one end to the other with gaps of 0.6 to 1.4 times the mean. Some spaces stay
/// empty. Vehicles parallel to the road face along the centreline on the right side of the road,
/// and against it on the left side, even on a one-way road. Half of the vehicles at an angle are
/// parked backwards.
/// @param centrelines centrelines of the scene's roads
/// @throws ConfigError for a row on an unknown road, beyond a road's end, or with too many vehicles
std::vector<ParkedVehicle> parked_vehicles(const SceneConfig& scene,
                                           std::span<const Curve> centrelines);

}  // namespace infrasim
