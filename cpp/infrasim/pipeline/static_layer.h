#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "infrasim/core/rays.h"
#include "infrasim/raycast/packets.h"
#include "infrasim/raycast/raycaster.h"
#include "infrasim/raycast/view_bounds.h"
#include "infrasim/sensor/scan_pattern.h"

namespace infrasim {

/// Rays worked on at once: they stay in the first-level cache.
inline constexpr std::int64_t kChunkRays = 4096;

/// The nearest thing that stands still, for each ray of a period of one unit, group by group.
struct StaticHits {
  std::int64_t groups = 0;  ///< of a period
  std::int64_t group_size = 0;
  float max_range_m = 0;
  std::uint64_t directions = 0;  ///< digest of those of the rays
  std::vector<float> range_m;    ///< +inf: nothing hit
  std::vector<float>
      gain;  ///< as Echo has it: the cosine of incidence; of a recording its intensity
  std::vector<std::uint16_t> class_id;  ///< 0: nothing hit

  std::size_t rays() const { return static_cast<std::size_t>(groups * group_size); }
};

/// Of the layers of a mount's LiDARs, together.
inline constexpr std::size_t kMostLayerBytes = std::size_t{256} << 20;

/// Of the layer of a pattern that repeats, at most.
std::size_t layer_bytes(const ScanPattern& pattern);

/// What a pattern is told by: groups, group size, range and digest; no hits.
/// @param pattern one that repeats
StaticHits no_hits(const ScanPattern& pattern, float max_range_m);

/// As the raycaster's background has it.
StaticHits cast_static(const ScanPattern& pattern, float max_range_m, Raycaster& raycaster);

/// Hits of some rays, one after the other.
struct StaticSlice {
  std::span<const float> range_m, gain;
  std::span<const std::uint16_t> class_id;
};

/// What stands still, as one unit whose pattern repeats sees it: the nearest hit of each ray of a
/// period, and where groups of near rays look, so that only those which can meet a vehicle are cast
/// again.
class StaticLayer {
 public:
  /// @param hits of this pattern
  StaticLayer(const ScanPattern& pattern, StaticHits hits);

  std::int64_t groups() const { return hits_.groups; }  ///< of one period

  /// The longest run of groups from `first` on that lies in one period, up to a whole number of
  /// blocks of near rays and at most `last`.
  std::int64_t part_end(std::int64_t first, std::int64_t last) const;

  /// Hits of the rays of a run of groups that `part_end` gave.
  StaticSlice slice(std::int64_t first_group, std::int64_t last_group) const;
  /// The same as hits; incidence is no cosine of what a recording saw, whose gain the slice has.
  void hits(std::int64_t first_group, std::int64_t last_group, bool incidence, HitBatch& out) const;

  /// Names the rays of such a run that may meet a body, near ones together.
  void select(std::int64_t first_group, std::int64_t last_group, const BodyIndex& bodies,
              std::vector<std::uint32_t>& selected) const;

  std::size_t bytes() const;

 private:
  StaticHits hits_;
  std::int64_t block_groups_;         ///< of a block, whose rays are near each other in `order_`
  std::vector<std::uint32_t> order_;  ///< of the rays of a block: a tile is a packet of it
  std::vector<ViewBounds> tiles_;     ///< of block after block
};

}  // namespace infrasim
