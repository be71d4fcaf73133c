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

/// Number of rays that are processed at once. They fit into the first-level cache.
inline constexpr std::int64_t kChunkRays = 4096;

/// The nearest static hit of each ray in a period of one unit, one group after the other.
struct StaticHits {
  std::int64_t groups = 0;  ///< number of groups in a period
  std::int64_t group_size = 0;
  float max_range_m = 0;
  std::uint64_t directions = 0;  ///< digest of the rays' directions
  std::vector<float> range_m;    ///< +inf: nothing hit
  std::vector<float>
      gain;  ///< gain of the Echo: the cosine of incidence, or the intensity of a recording
  std::vector<std::uint16_t> class_id;  ///< 0: nothing hit

  std::size_t rays() const { return static_cast<std::size_t>(groups * group_size); }
};

/// Maximum size of all layers of a run together.
inline constexpr std::size_t kMostLayerBytes = std::size_t{256} << 20;

/// Returns the maximum size of the layer of a repeating pattern.
std::size_t layer_bytes(const ScanPattern& pattern);

/// Returns the identity of a pattern, without hits: groups, group size, range and digest.
/// @param pattern a repeating pattern
StaticHits no_hits(const ScanPattern& pattern, float max_range_m);

/// Casts a period of the pattern at the raycaster's background.
StaticHits cast_static(const ScanPattern& pattern, float max_range_m, Raycaster& raycaster);

/// Static hits of the rays of a batch.
struct StaticSlice {
  std::span<const float> range_m, gain;  ///< hits of consecutive rays of the pattern
  std::span<const std::uint16_t> class_id;
  std::span<const std::uint32_t> number;  ///< number of each ray of the batch in these columns

  bool empty() const { return range_m.empty(); }
};

/// The static scene as seen by one unit with a repeating pattern. It stores the nearest hit of each
/// ray of a period, whether the ray can give a point, and its ways through leaves. It also stores
/// the views of groups of neighbouring rays, so that only rays that may meet a vehicle are cast
/// again.
class StaticLayer {
 public:
  /// @param hits    hits of this pattern
  /// @param returns return model of the unit
  /// @param leaves  volumes of leaves; only LiDARs that detect by received power see them
  /// @param half_width tangent of the angle between a ray and its outermost sub-rays
  StaticLayer(const ScanPattern& pattern, StaticHits hits, const ReturnModel& returns,
              const Volumes& leaves, float half_width = 0);

  std::int64_t groups() const { return hits_.groups; }  ///< number of groups in a period

  /// Returns the end of the longest run of groups that begins with `first` and lies in one period.
  /// The run consists of whole blocks of neighbouring rays, or it ends at `last`.
  std::int64_t part_end(std::int64_t first, std::int64_t last) const;

  /// Returns the hits of the rays in a run of groups, which `part_end` has determined.
  /// @param number numbers of the batch's rays in the run
  StaticSlice slice(std::int64_t first_group, std::int64_t last_group,
                    std::span<const std::uint32_t> number) const;

  /// Sets `out` to the rays of a run that can give a point of a static surface or, if the ways
  /// through leaves are known, of leaves: their numbers in the run, ascending.
  void candidates(std::int64_t first_group, std::int64_t last_group,
                  std::vector<std::uint32_t>& out) const;

  /// Whether the ways through leaves are known. They are not if they would take too much memory.
  bool knows_leaves() const { return knows_leaves_; }
  /// Ways of the rays of a run through leaves, by increasing number of the ray in the period.
  std::span<const Volumes::RayWay> leaf_ways(std::int64_t first_group,
                                             std::int64_t last_group) const;
  /// Number of the run's first ray in the period.
  std::uint32_t first_ray(std::int64_t first_group) const {
    return static_cast<std::uint32_t>(first_group % hits_.groups * hits_.group_size);
  }

  /// Selects the rays of a batch (see `part_end`) that may meet a body. Neighbouring rays stay
  /// adjacent.
  void select(std::int64_t first_group, std::int64_t last_group, const BodyIndex& bodies,
              std::vector<std::uint32_t>& selected) const;

  /// Whether the hit of any ray is on a recorded surface.
  bool has_recorded() const { return has_recorded_; }

  std::size_t bytes() const;

 private:
  void add_tiles(const RayBatch& block, float half_width);
  void mark(std::size_t ray);
  void mark_surfaces(const RayBatch& block, std::size_t first, const ReturnModel& returns);
  void add_leaf_ways(const RayBatch& block, std::size_t first, const ReturnModel& returns,
                     const Volumes& leaves, std::vector<std::uint32_t>& candidates);

  StaticHits hits_;
  /// number of groups in a block, whose neighbouring rays are adjacent in `order_`
  std::int64_t block_groups_;
  std::vector<std::uint32_t> order_;  ///< order of the rays in a block; a tile is a packet of it
  std::vector<ViewBounds> tiles_;     ///< views of the tiles, block by block
  std::vector<std::uint64_t> candidates_;  ///< one bit per ray
  std::vector<Volumes::RayWay> leaf_ways_;
  bool knows_leaves_ = true;
  bool has_recorded_ = false;
};

}  // namespace infrasim
