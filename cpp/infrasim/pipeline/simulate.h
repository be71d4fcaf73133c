#pragma once

#include <cstddef>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/core/frame.h"
#include "infrasim/filter/filter.h"
#include "infrasim/pipeline/static_layer.h"
#include "infrasim/pipeline/world.h"

namespace infrasim {

/// Of each LiDAR, the static layer of each unit; null where the pattern never repeats, a beam is
/// wider than a ray, or a layer costs more than it saves. Shared by the simulators of all threads.
/// No entry at all: all rays are cast.
using StaticLayers = std::vector<std::vector<std::shared_ptr<const StaticLayer>>>;
/// Those that the scene names a file for are read, the others cast: as far as kMostLayerBytes go,
/// and where the frames have no fewer rays than the period that is cast for them.
/// @param frames how many will be simulated
/// @throws ConfigError for a file that is of another LiDAR, or of another scene
StaticLayers make_static_layers(const World& world, std::span<const LidarConfig> lidars,
                                std::size_t frames = std::numeric_limits<std::size_t>::max());

/// Of each LiDAR, the scene's filters. Shared by the simulators of all threads.
using LidarFilters = std::vector<std::shared_ptr<const std::vector<FilterStep>>>;

/// Computes frames of several LiDARs at one mount. For one thread at a time.
class FrameSimulator {
 public:
  FrameSimulator(const World& world, std::span<const LidarConfig> lidars)
      : FrameSimulator(world, lidars, make_static_layers(world, lidars)) {}
  /// @param layers of these LiDARs in this world; frames are the same with any and with none
  FrameSimulator(const World& world, std::span<const LidarConfig> lidars,
                 const StaticLayers& layers)
      : FrameSimulator(world, lidars, layers, learn_filters(world, lidars, layers)) {}
  /// @param filters of these LiDARs in this world
  FrameSimulator(const World& world, std::span<const LidarConfig> lidars,
                 const StaticLayers& layers, const LidarFilters& filters);
  ~FrameSimulator();
  FrameSimulator(FrameSimulator&&) noexcept;

  /// The scene's filters, a background learnt from frames without vehicles.
  static LidarFilters learn_filters(const World& world, std::span<const LidarConfig> lidars,
                                    const StaticLayers& layers);

  /// Frame k of the LiDARs whose entry in `wanted` is true; the others stay empty. A frame is a
  /// pure function of scene, seed, LiDAR and k.
  /// @throws ConfigError if the scene has no frame k
  std::vector<Frame> simulate(int k, const std::vector<bool>& wanted);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace infrasim
