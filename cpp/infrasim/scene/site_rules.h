#pragma once

#include "infrasim/scene/site.h"

// What a site can be. Rules about one key stand where the key is read; these are about two things
// that can't both be as they are.

namespace infrasim {

/// @throws ConfigError, with the place of what is wrong, for roads that meet on one level without a
/// junction, ground or a slope on a road, something that stands on a lane, more vehicles than a
/// site has, and a sensor where none can be (sensor_rules.h)
void check_site(const Site& site);

/// A site that was built and checked.
/// @throws what build_site and check_site do
Site checked_site(const SceneConfig& scene);

}  // namespace infrasim
