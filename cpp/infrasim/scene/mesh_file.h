#pragma once

#include <string>
#include <vector>

#include "infrasim/config/scene_config.h"

namespace infrasim {

/// A line for each of the scene's meshes in which triangles have no area: no ray meets them.
/// @throws what read_ply does
std::vector<std::string> flat_triangles(const SceneConfig& scene);

}  // namespace infrasim
