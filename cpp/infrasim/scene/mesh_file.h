#pragma once

#include <string>
#include <vector>

#include "infrasim/config/scene_config.h"
#include "infrasim/scene/profile.h"
#include "infrasim/scene/site.h"

namespace infrasim {

/// Returns a line for each mesh of the scene with triangles of zero area, which no ray can hit.
/// @throws the exceptions of read_ply
std::vector<std::string> flat_triangles(const SceneConfig& scene);

/// Returns a warning for each file of `meshes` whose size suggests centimetres or millimetres, one
/// line per file.
/// @param surface the site's static surface
std::vector<std::string> unit_warnings(const Site& site, const Surface& surface);

}  // namespace infrasim
