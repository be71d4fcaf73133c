#include "infrasim/pipeline/frame_stream.h"

#include <algorithm>

namespace infrasim {

namespace {

/// @throws ConfigError if the scene has other values under the preset of a LiDAR, or if LiDARs have
///   different periods
std::vector<LidarConfig> of_its_preset(const World& world, std::vector<LidarConfig> lidars) {
  const auto has_block = [&](const std::string& preset) {
    return std::ranges::find(world.scene.preset_blocks, preset) != world.scene.preset_blocks.end();
  };
  period_s(lidars);  // throws for different periods
  const std::string& read = world.scene.preset;
  for (const LidarConfig& lidar : lidars)
    if (lidar.preset != read && (has_block(lidar.preset) || has_block(read)))
      throw ConfigError(lidar.name + ": preset: expected '" + read +
                        "', for which the scene was read, got '" + lidar.preset + "'");
  return lidars;
}

}  // namespace

FrameStream::FrameStream(const World& world, const std::vector<LidarConfig>& lidars,
                         std::vector<int> frames, int threads)
    : scheduler_(world, of_its_preset(world, lidars),
                 {.frames = std::move(frames),
                  .threads = threads,
                  .ahead = 2 * static_cast<std::size_t>(threads)},
                 [all = std::vector<bool>(lidars.size(), true)](FrameSimulator& simulator, int k) {
                   return simulator.simulate(k, all);
                 }) {}

}  // namespace infrasim
