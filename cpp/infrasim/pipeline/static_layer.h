#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "infrasim/core/rays.h"
#include "infrasim/raycast/packets.h"
#include "infrasim/raycast/raycaster.h"
#include "infrasim/raycast/view_bounds.h"
#include "infrasim/raycast/volumes.h"
#include "infrasim/sensor/return_model.h"
#include "infrasim/sensor/scan_pattern.h"

namespace infrasim {

/// Approximate number of rays that are processed at once, so that they fit into the first-level
/// cache.
inline constexpr std::int64_t kChunkRays = 4096;

/// The nearest static hit of each ray in one period of a unit's scan pattern, one ray group after
/// the other.
struct StaticHits {
  std::int64_t groups = 0;  ///< number of groups in a period
  std::int64_t group_size = 0;
  float max_range_m = 0;
  std::uint64_t directions = 0;  ///< digest of the directions of all rays
  std::vector<float> range_m;    ///< range of the hit; +inf if nothing is hit
  std::vector<float>
      gain;  ///< gain of the echo: the cosine of incidence, or the intensity of a recording
  std::vector<std::uint16_t> class_id;  ///< class of the surface; 0 if nothing is hit

  std::size_t rays() const { return static_cast<std::size_t>(groups * group_size); }
};

/// Maximum total size of all static layers of a run, in bytes.
inline constexpr std::size_t kMostLayerBytes = std::size_t{256} << 20;

/// Returns the maximum size of the static layer of a repeating scan pattern, in bytes.
std::size_t layer_bytes(const ScanPattern& pattern);

/// Returns a layer in which no ray has a hit. Its groups, group size, maximum range and digest
/// identify the pattern.
/// @param pattern a repeating pattern
StaticHits no_hits(const ScanPattern& pattern, float max_range_m);

/// Casts all rays of one period of the pattern at the static background of the raycaster.
StaticHits cast_static(const ScanPattern& pattern, float max_range_m, Raycaster& raycaster);

/// Static hits of the rays of a batch.
struct StaticSlice {
  std::span<const float> range_m, gain;  ///< hits of consecutive rays of the pattern
  std::span<const std::uint16_t> class_id;
  /// for each ray of the batch, its index in the columns above
  std::span<const std::uint32_t> number;

  bool empty() const { return range_m.empty(); }
};

/// The static scene as seen by one unit with a repeating pattern. It stores the nearest hit of each
/// ray of a period, whether the ray can give a point, and its paths through leaves. It also stores
/// the angular bounds of groups of neighbouring rays, so that only rays that may meet a vehicle are
/// cast again.
class StaticLayer {
 public:
  /// @param hits    hits of this pattern
  /// @param returns return model of the unit
  /// @param leaves  volumes of leaves, which affect only LiDARs that detect by received power
  /// @param half_width tangent of the angle between a ray and its outermost sub-rays
  StaticLayer(const ScanPattern& pattern, StaticHits hits, const ReturnModel& returns,
              const Volumes& leaves, float half_width = 0);

  std::int64_t groups() const { return hits_.groups; }  ///< number of groups in a period

  /// Returns the end of the run of ray groups that begins with `first` and is processed at once.
  /// The run lies in one period. It ends after a whole block of neighbouring rays, or at `last`.
  std::int64_t part_end(std::int64_t first, std::int64_t last) const;

  /// Returns the hits of the rays in a run of groups, which `part_end` has determined.
  /// @param number numbers of the batch's rays, counted from the first ray of the run
  StaticSlice slice(std::int64_t first_group, std::int64_t last_group,
                    std::span<const std::uint32_t> number) const;

  /// Sets `out` to the numbers of the rays of a run that can give a point of a static surface, in
  /// ascending order. Rays that can give a point of leaves are added if the layer stores the paths
  /// through leaves.
  void candidates(std::int64_t first_group, std::int64_t last_group,
                  std::vector<std::uint32_t>& out) const;

  /// Returns whether the layer stores the paths of rays through leaves. It does not if the paths
  /// need too much memory, or if leaves do not affect the LiDAR.
  bool knows_leaves() const { return knows_leaves_; }
  /// Returns the paths of the rays of a run through leaves, by increasing number of the ray in the
  /// period.
  std::span<const Volumes::RayWay> leaf_ways(std::int64_t first_group,
                                             std::int64_t last_group) const;
  /// Returns the number, within the period, of the run's first ray.
  std::uint32_t first_ray(std::int64_t first_group) const {
    return static_cast<std::uint32_t>(first_group % hits_.groups * hits_.group_size);
  }

  /// Selects the rays of a run of groups (see `part_end`) that may meet a moving body. Neighbouring
  /// rays stay adjacent.
  void select(std::int64_t first_group, std::int64_t last_group, const BodyIndex& bodies,
              std::vector<std::uint32_t>& selected) const;

  /// Returns whether the hit of any ray is on a recorded surface.
  bool has_recorded() const { return has_recorded_; }

  std::size_t bytes() const;

 private:
  void add_tiles(const RayBatch& block, float half_width);
  void mark(std::size_t ray);
  void mark_surfaces(const RayBatch& block, std::size_t first, const ReturnModel& returns);
  void add_leaf_ways(const RayBatch& block, std::size_t first, const ReturnModel& returns,
                     const Volumes& leaves, std::vector<std::uint32_t>& candidates);

  StaticHits hits_;
  /// number of ray groups in a block; neighbouring rays of a block are adjacent in `order_`
  std::int64_t block_groups_;
  std::vector<std::uint32_t> order_;  ///< order of the rays in a block; adjacent rays form a tile
  std::vector<ViewBounds> tiles_;     ///< angular bounds of the tiles, block by block
  std::vector<std::uint64_t> candidates_;  ///< one bit per ray, set if the ray can give a point
  std::vector<Volumes::RayWay> leaf_ways_;
  bool knows_leaves_ = true;
  bool has_recorded_ = false;
};

}  // namespace infrasim
