#pragma once

#include <functional>
#include <string>
#include <vector>

#include "infrasim/filter/filter.h"
#include "infrasim/scene/site.h"

namespace infrasim {

/// Checks that each ground_plane filter without sensor_height_m can use the height of the mount
/// above the road instead.
/// @throws ConfigError
void check_filters(const Site& site, const std::string& name, const MountConfig& mount);

/// Makes the filters of a scene for one LiDAR at a mount.
/// @param empty_frame  returns the row-major points of frame k of the LiDAR in the scene without
///   vehicles, from which a background is learnt
std::vector<FilterStep> make_filters(const Site& site, const MountConfig& mount,
                                     const std::function<std::vector<float>(int)>& empty_frame);

}  // namespace infrasim
