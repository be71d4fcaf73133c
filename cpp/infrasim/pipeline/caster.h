#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/core/aggregation.h"
#include "infrasim/core/rng.h"
#include "infrasim/pipeline/frame_builder.h"
#include "infrasim/pipeline/static_layer.h"
#include "infrasim/pipeline/transparent.h"
#include "infrasim/pipeline/vehicles.h"
#include "infrasim/raycast/raycaster.h"
#include "infrasim/raycast/volumes.h"
#include "infrasim/sensor/beam.h"
#include "infrasim/sensor/echoes.h"
#include "infrasim/sensor/return_model.h"
#include "infrasim/sensor/scan_pattern.h"

namespace infrasim {

/// One optical unit of a LiDAR, ready to fire.
struct ScannerUnit {
  ScanPattern pattern;
  ReturnModel returns;
  std::optional<Beam> beam;
  float max_range;
  Rng stream;                                                      ///< of its random numbers
  std::map<std::int64_t, std::vector<std::uint32_t>> tile_orders;  ///< by number of groups
  std::shared_ptr<const StaticLayer> layer;                        ///< null: all rays are cast

  /// Whether a static layer can answer: it repeats soon enough, and no beam is wider than a ray.
  bool can_have_layer() const {
    return pattern.repeats_after() > 0 && !beam && layer_bytes(pattern) <= kMostLayerBytes;
  }

  /// Rays that are fired within a share of frame k.
  RayRange rays(int k, double from = 0, double to = 1) const;
};

/// Rotation from a unit's frame to the levelled frame.
Mat3 unit_pose(const SceneConfig& scene, const LidarUnit& unit);

/// All units of a LiDAR.
/// @param draws put before the names of their streams of random numbers
std::vector<ScannerUnit> make_scanner_units(const SceneConfig& scene, const LidarConfig& lidar,
                                            const std::string& draws = "");

/// Casts the rays of LiDARs and makes returns of what comes back, part of a frame by part: cast,
/// stop in leaves, pass panes, merge beams, detect. Keeps its buffers from frame to frame. For one
/// thread at a time.
class Caster {
 public:
  /// @param parts  that LiDARs which detect by received power see of vehicles
  /// @param leaves that they see; outlive the caster
  Caster(Raycaster& raycaster, const VehicleParts& parts, const Volumes& leaves)
      : raycaster_(raycaster), parts_(parts), leaves_(leaves), transparent_(raycaster) {}

  /// Adds the returns of the rays that the unit fires in one slice of frame k.
  /// @param vehicles those that the raycaster has
  /// @return how many rays were cast for them: fewer where a static layer answers, more where beams
  ///         are wider than a ray
  std::size_t cast(int k, const WorldSlice& slice, const FrameVehicles& vehicles,
                   ScannerUnit& scanner, FrameBuilder& out);

 private:
  /// A run of groups that one unit fires, worked on at once.
  struct Part {
    ScannerUnit& scanner;
    const FrameVehicles& vehicles;
    std::int64_t first, last;  ///< groups
    const Rng& frame;          ///< random numbers of the unit and frame
    std::uint64_t first_ray;   ///< of the part, within the frame

    std::int64_t groups() const { return last - first; }
    bool by_power() const { return scanner.returns.needs_reflectance(); }
  };

  std::size_t cast_rays(const Part& part);
  void stop_in_leaves(const Part& part);
  std::size_t pass_panes(const Part& part);
  void merge_beams(const Part& part);
  void detect(const Part& part, FrameBuilder& out);

  void select(const Part& part);
  void cast_moving(const StaticLayer& layer, const Part& part);
  const RayBatch& rays_cast(const Part& part) const;
  std::span<const std::uint32_t> order_for_leaves(const Part& part);
  void collect(std::span<const MovingObject> objects, bool wide, const EchoBatch& echoes,
               FrameBuilder& out) const;

  Raycaster& raycaster_;
  VehicleParts parts_;
  const Volumes& leaves_;
  TransparentCaster transparent_;
  RayBatch rays_;
  std::vector<std::uint32_t> selected_;   ///< rays worth casting
  std::vector<std::uint32_t> in_leaves_;  ///< rays that may meet leaves
  RayBatch sub_rays_;                     ///< of the selected rays, where beams are wider than rays
  std::vector<std::uint32_t> sub_selected_;
  HitBatch hits_;     ///< of the rays, or of the sub-rays, until they become echoes
  EchoBatch echoes_;  ///< of the same
  EchoBatch beam_echoes_;
  std::vector<float> sunlit_;  ///< of the beams
  ReturnBatch returns_;
};

}  // namespace infrasim
