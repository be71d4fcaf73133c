#pragma once

#include <string>
#include <vector>

#include "infrasim/config/scene_config.h"

namespace infrasim {

/// Returns a line for each mesh of the scene with triangles of zero area, which no ray can hit.
/// @throws the exceptions of read_ply
std::vector<std::string> flat_triangles(const SceneConfig& scene);

}  // namespace infrasim
