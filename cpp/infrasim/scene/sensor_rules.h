#pragma once

#include <string>

#include "infrasim/scene/profile.h"
#include "infrasim/scene/site.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// @throws ConfigError for a sensor inside the ground or an object, in the path of vehicles on a
///   lane, or too far from or too high above all roads, lanes and ground
void check_sensor_at(const Site& site, const std::string& name, const MountConfig& mount);

/// Returns the height of a point above the highest road, lane or ground that is lower than the
/// point and less than 50 m away horizontally. Without such a surface, the height is relative to
/// the lowest surface of the scene. If the scene has no surface, the height is infinite. All
/// heights are those of the scene file, before the profile raises the scene.
double height_above_surface(const Site& site, Vec2 foot, double z);

/// @param surface the site's static surface
/// @throws ConfigError for a sensor inside a building of the meshes, or below a road, footway or
///   terrain of a mesh that is not a bridge
void check_sensor_in_meshes(const Site& site, const std::string& name, const MountConfig& mount,
                            const Surface& surface);

/// @param states objects at an instant of the scene
/// @throws ConfigError if a vehicle drives through the sensor
void check_sensor_is_free(const SceneConfig& scene, const std::vector<ObjectState>& states,
                          int instant);

}  // namespace infrasim
