#pragma once

#include <span>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/pipeline/caster.h"
#include "infrasim/pipeline/static_layer.h"
#include "infrasim/pipeline/world.h"

namespace infrasim {

/// Returns the names of a LiDAR and its preset, for messages.
std::string words_of(const LidarConfig& lidar);

/// Returns a static layer without hits for each unit, which identifies the unit's scan pattern.
/// @param scanners the LiDAR's units
/// @throws ConfigError, with the reason, for a LiDAR that can't have a static layer
std::vector<StaticHits> units_without_hits(const LidarConfig& lidar,
                                           std::span<const ScannerUnit> scanners);

/// Casts one period of each unit's rays at the static surfaces of the scene.
/// @throws ConfigError, with the reason, for a LiDAR that can't have a static layer
std::vector<StaticHits> cast_static_layer(const World& world, const LidarConfig& lidar);

}  // namespace infrasim
