#pragma once

#include <span>
#include <vector>

#include "infrasim/config/scene_config.h"
#include "infrasim/scene/curve.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

inline constexpr int kFirstParkedId = 1'000'000'000;  ///< beyond those of traffic

/// A vehicle that stands for the whole of a run, and the row that says so.
struct ParkedVehicle {
  ObjectState state;
  config::Place place;
};

/// All of a scene, by increasing id, drawn from its seed. From one end of a row to the other stands
/// a vehicle after the other, with gaps of 0.6 to 1.4 of the mean, or its place stays empty. Along
/// the road they face as its traffic on their side does; at an angle half of them head out.
/// @param centrelines of the scene's roads
/// @throws ConfigError for a row of an unknown road, beyond its end, or of too many vehicles
std::vector<ParkedVehicle> parked_vehicles(const SceneConfig& scene,
                                           std::span<const Curve> centrelines);

}  // namespace infrasim
