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
#include "infrasim/pipeline/frame_builder.h"
#include "infrasim/pipeline/stage_times.h"
#include "infrasim/pipeline/static_layer.h"
#include "infrasim/pipeline/world.h"

namespace infrasim {

/// The static layer of each unit of each LiDAR. An entry is null if the pattern never repeats, if
/// beams have sub-rays at every distance, if the layer is too large, or if it costs more time than
/// it saves.
/// The simulators of all threads share the layers. If the outer vector is empty, all rays are cast.
using StaticLayers = std::vector<std::vector<std::shared_ptr<const StaticLayer>>>;
/// Makes static layers. A layer is read if the scene names a file for it. Other layers are cast, up
/// to `most_bytes` in total. A layer is cast only if the frames have at least as many rays as a
/// period of the pattern.
/// @param frames number of frames that will be simulated
/// @throws ConfigError for a file of another LiDAR or another scene
StaticLayers make_static_layers(const World& world, std::span<const LidarConfig> lidars,
                                std::size_t frames = std::numeric_limits<std::size_t>::max(),
                                std::size_t most_bytes = kMostLayerBytes);

/// The scene's filters for each LiDAR. The simulators of all threads share the filters.
using LidarFilters = std::vector<std::shared_ptr<const std::vector<FilterStep>>>;

/// One object in the evaluation region, as seen by one LiDAR in one frame.
struct Observation {
  int id = 0;
  PointSpread points;
  double distance = 0;    ///< horizontal distance from sensor to box centre at mid-frame, metres
  double visibility = 0;  ///< visible share of the object, 0 to 1
};

/// Computes frames of several LiDARs at one mount. The LiDARs must have the same frame period. The
/// constructors throw ConfigError if the periods differ. Not thread-safe.
class FrameSimulator {
 public:
  FrameSimulator(const World& world, std::span<const LidarConfig> lidars)
      : FrameSimulator(world, lidars, make_static_layers(world, lidars)) {}
  /// @param layers static layers of these LiDARs in this world; they save time and do not change
  ///   the frames
  FrameSimulator(const World& world, std::span<const LidarConfig> lidars,
                 const StaticLayers& layers)
      : FrameSimulator(world, lidars, layers, learn_filters(world, lidars, layers)) {}
  /// @param filters filters for these LiDARs in this world
  FrameSimulator(const World& world, std::span<const LidarConfig> lidars,
                 const StaticLayers& layers, const LidarFilters& filters);
  ~FrameSimulator();
  FrameSimulator(FrameSimulator&&) noexcept;

  /// Returns the scene's filters for each LiDAR. Background filters learn from frames without
  /// vehicles.
  static LidarFilters learn_filters(const World& world, std::span<const LidarConfig> lidars,
                                    const StaticLayers& layers);

  /// Computes frame k of the LiDARs whose entry in `wanted` is true. The frames of the other LiDARs
  /// are empty. A frame is a pure function of scene, seed, LiDAR and k.
  /// @throws ConfigError if the scene has no frame k
  std::vector<Frame> simulate(int k, const std::vector<bool>& wanted);

  /// Returns what each LiDAR sees of the objects of frame k, without the scene's filters. Only rays
  /// that may meet an object are cast. The simulator must have neither layers nor filters, and must
  /// not be used for `simulate` afterwards.
  /// @throws ConfigError if the scene has no frame k
  std::vector<std::vector<Observation>> observe(int k);

  const LidarFilters& filters() const;

  /// Adds the CPU time of each stage of all following frames to `times`, which must exist while the
  /// frames are computed.
  void measure(StageTimes& times);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace infrasim
