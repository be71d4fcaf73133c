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

/// Returns the identity of each unit's static layer, without hits.
/// @param scanners the LiDAR's units
/// @throws ConfigError, with the reason, for a LiDAR that can't have a static layer
std::vector<StaticHits> units_without_hits(const LidarConfig& lidar,
                                           std::span<const ScannerUnit> scanners);

/// Casts the static scene as seen by each unit of a LiDAR.
/// @throws ConfigError, with the reason, for a LiDAR that can't have a static layer
std::vector<StaticHits> cast_static_layer(const World& world, const LidarConfig& lidar);

}  // namespace infrasim
