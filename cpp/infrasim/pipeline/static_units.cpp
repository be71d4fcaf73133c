#include "infrasim/pipeline/static_units.h"

#include "infrasim/core/errors.h"

namespace infrasim {

namespace {

/// @throws ConfigError, with the reason, for a LiDAR that can't have a static layer
void check_can_have_layer(const LidarConfig& lidar, std::span<const ScannerUnit> scanners) {
  for (std::size_t i = 0; i < scanners.size(); ++i) {
    const ScannerUnit& unit = scanners[i];
    if (unit.can_have_layer()) continue;
    const std::string problem =
        unit.beam && unit.beam->everywhere() ? "beams with sub-rays everywhere"
        : unit.pattern.repeats_after() == 0
            ? "a pattern that never repeats"
            : "a pattern of " + std::to_string(layer_bytes(unit.pattern)) + " bytes";
    throw ConfigError(words_of(lidar) + ": unit " + std::to_string(i) +
                      ": expected a pattern of single rays that repeats and needs up to " +
                      std::to_string(kMostLayerBytes) + " bytes, for a static layer, got " +
                      problem);
  }
}

}  // namespace

std::string words_of(const LidarConfig& lidar) { return lidar.name + ", preset " + lidar.preset; }

std::vector<StaticHits> units_without_hits(const LidarConfig& lidar,
                                           std::span<const ScannerUnit> scanners) {
  check_can_have_layer(lidar, scanners);
  std::vector<StaticHits> units;
  for (const ScannerUnit& e : scanners) units.push_back(no_hits(e.pattern, e.max_range));
  return units;
}

std::vector<StaticHits> cast_static_layer(const World& world, const LidarConfig& lidar) {
  const std::vector<ScannerUnit> scanners = make_scanner_units(world.scene, lidar);
  check_can_have_layer(lidar, scanners);
  Raycaster raycaster = world.raycaster();
  std::vector<StaticHits> units;
  for (const ScannerUnit& scanner : scanners)
    units.push_back(cast_static(scanner.pattern, scanner.max_range, raycaster));
  return units;
}

}  // namespace infrasim
