#pragma once

#include <functional>
#include <vector>

#include "infrasim/config/scene_config.h"
#include "infrasim/filter/filter.h"

namespace infrasim {

/// The filters of a scene for one LiDAR, ready to use.
/// @param empty_frame  gives the row-major points of frame k of the LiDAR in the scene without
///                     vehicles, to learn from
std::vector<FilterStep> make_filters(const SceneConfig& scene,
                                     const std::function<std::vector<float>(int)>& empty_frame);

}  // namespace infrasim
