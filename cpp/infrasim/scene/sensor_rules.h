#pragma once

#include "infrasim/core/triangle_mesh.h"
#include "infrasim/scene/site.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// @throws ConfigError for a sensor inside the ground or an object, in the path of vehicles on a
///   lane, or too far from all roads and objects
void check_sensor(const Site& site);

/// @param background static surfaces in the levelled frame of the scene's mount
/// @throws ConfigError for a sensor below a road, footway or terrain of a mesh that is not a bridge
void check_sensor_above(const SceneConfig& scene, const TriangleMesh& background);

/// @param states objects at an instant of the scene
/// @throws ConfigError if a vehicle drives through the sensor
void check_sensor_is_free(const SceneConfig& scene, const std::vector<ObjectState>& states,
                          int instant);

}  // namespace infrasim
