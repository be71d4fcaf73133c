#pragma once

#include <functional>
#include <vector>

#include "infrasim/filter/filter.h"
#include "infrasim/scene/site.h"

namespace infrasim {

/// Makes the filters of a scene for one LiDAR at a mount.
/// @param empty_frame  returns the row-major points of frame k of the LiDAR in the scene without
///   vehicles, from which a background is learnt
std::vector<FilterStep> make_filters(const Site& site, const MountConfig& mount,
                                     const std::function<std::vector<float>(int)>& empty_frame);

}  // namespace infrasim
