#pragma once

#include <span>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/pipeline/caster.h"
#include "infrasim/pipeline/static_layer.h"
#include "infrasim/pipeline/world.h"

namespace infrasim {

/// A LiDAR and its preset, for messages.
std::string words_of(const LidarConfig& lidar);

/// What each unit's static layer is told by, and no hits.
/// @param scanners its units
/// @throws ConfigError, with the reason, for a LiDAR that can have no static layer
std::vector<StaticHits> units_without_hits(const LidarConfig& lidar,
                                           std::span<const ScannerUnit> scanners);

/// What stands still in the world, as each unit of a LiDAR sees it.
/// @throws ConfigError, with the reason, for a LiDAR that can have no static layer
std::vector<StaticHits> cast_static_layer(const World& world, const LidarConfig& lidar);

}  // namespace infrasim
