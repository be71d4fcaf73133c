#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/config/scene_config.h"
#include "infrasim/core/rng.h"
#include "infrasim/pipeline/static_layer.h"
#include "infrasim/sensor/beam.h"
#include "infrasim/sensor/return_model.h"
#include "infrasim/sensor/scan_pattern.h"

namespace infrasim {

/// One optical unit of a LiDAR, with all data that its rays require.
struct ScannerUnit {
  ScanPattern pattern;
  ReturnModel returns;
  std::optional<Beam> beam;  ///< present if rays have a divergence or several echoes
  float max_range;
  double period_s;  ///< frame period
  Rng stream;       ///< random number generator of the unit
  /// order of the rays in tiles of neighbouring rays, by number of ray groups
  std::map<std::int64_t, std::vector<std::uint32_t>> tile_orders;
  std::shared_ptr<const StaticLayer> layer;  ///< static layer; if null, all rays are cast

  /// Returns whether the unit can have a static layer. The pattern must repeat, static surfaces
  /// must be cast with single rays, and the layer must fit into the memory limit.
  bool can_have_layer() const {
    return pattern.repeats_after() > 0 && !(beam && beam->everywhere()) &&
           layer_bytes(pattern) <= kMostLayerBytes;
  }
  /// Returns the tangent of the angle between a ray and its outermost sub-rays.
  float half_width() const { return beam ? beam->half_width() : 0; }

  /// Returns the rays that are fired between two instants of frame k, given as shares of the frame.
  RayRange rays(int k, double from = 0, double to = 1) const;
};

/// Returns the rotation from a unit's frame to the levelled frame.
Mat3 unit_pose(const SceneConfig& scene, const LidarUnit& unit);

/// Makes all units of a LiDAR.
/// @param stream_prefix prefix of the names of the units' random streams
std::vector<ScannerUnit> make_scanner_units(const SceneConfig& scene, const LidarConfig& lidar,
                                            const std::string& stream_prefix = "");

}  // namespace infrasim
