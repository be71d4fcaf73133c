#pragma once

#include "infrasim/config/scene_config.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// @throws ConfigError for a sensor in the ground, in what stands there, in the way of the vehicles
/// of a lane, or out of reach of everything
void check_sensor(const SceneConfig& scene);

/// @throws ConfigError if a vehicle drives through the sensor
void check_sensor_is_free(const SceneConfig& scene, const Trajectories& trajectories);

}  // namespace infrasim
