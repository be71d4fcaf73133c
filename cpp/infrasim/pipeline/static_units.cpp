#include "infrasim/pipeline/static_units.h"

#include "infrasim/core/errors.h"

namespace infrasim {

std::string words_of(const LidarConfig& lidar) { return lidar.name + ", preset " + lidar.preset; }

namespace {

/// @throws ConfigError, with the reason, for a LiDAR that can have no static layer
void check_can_have_layer(const LidarConfig& lidar, std::span<const Emitter> emitters) {
  for (std::size_t i = 0; i < emitters.size(); ++i) {
    const Emitter& unit = emitters[i];
    if (unit.can_have_layer()) continue;
    const std::string found =
        unit.beam ? "a beam wider than a ray"
        : unit.pattern.repeats_after() == 0
            ? "a pattern that never repeats"
            : "a pattern of " + std::to_string(layer_bytes(unit.pattern)) + " bytes";
    throw ConfigError(words_of(lidar) + ": unit " + std::to_string(i) + ": found " + found +
                      ", allowed single rays that repeat, of up to " +
                      std::to_string(kMostLayerBytes) + " bytes, for a static layer");
  }
}

}  // namespace

std::vector<StaticHits> units_without_hits(const LidarConfig& lidar,
                                           std::span<const Emitter> emitters) {
  check_can_have_layer(lidar, emitters);
  std::vector<StaticHits> units;
  for (const Emitter& e : emitters) units.push_back(no_hits(e.pattern, e.max_range));
  return units;
}

std::vector<StaticHits> cast_static_layer(const World& world, const LidarConfig& lidar) {
  const std::vector<Emitter> emitters = make_emitters(world.scene, lidar);
  check_can_have_layer(lidar, emitters);
  Raycaster raycaster(*world.meshes);
  std::vector<StaticHits> units;
  for (const Emitter& emitter : emitters)
    units.push_back(cast_static(emitter.pattern, emitter.max_range, raycaster));
  return units;
}

}  // namespace infrasim
