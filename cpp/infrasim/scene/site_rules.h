#pragma once

#include "infrasim/scene/site.h"

// Checks a site for contradictions between several keys. A rule about a single key is checked where
// the key is read.

namespace infrasim {

/// Builds a site and checks it.
/// @throws the exceptions of build_site, and ConfigError, with the position of the error, for roads
///   that meet at the same height without a junction, ground or a slope on a road, an object on a
///   lane, too many vehicles, and a sensor at an impossible position (sensor_rules.h)
Site checked_site(const SceneConfig& scene);

}  // namespace infrasim
