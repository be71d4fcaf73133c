#pragma once

#include <cstdint>
#include <vector>

#include "infrasim/core/rays.h"
#include "infrasim/raycast/packets.h"
#include "infrasim/raycast/raycaster.h"
#include "infrasim/raycast/view_bounds.h"
#include "infrasim/sensor/scan_pattern.h"

namespace infrasim {

/// Rays worked on at once: they stay in the first-level cache.
inline constexpr std::int64_t kChunkRays = 4096;

/// What stands still, as one unit whose pattern repeats sees it: the nearest hit of each ray of a
/// period, and where groups of near rays look, so that only those which can meet a vehicle are cast
/// again.
class StaticLayer {
 public:
  /// @param pattern one that repeats
  StaticLayer(const ScanPattern& pattern, float max_range_m, Raycaster& raycaster);

  std::int64_t groups() const { return groups_; }  ///< of one period

  /// The longest run of groups from `first` on that lies in one period, up to a whole number of
  /// blocks of near rays and at most `last`.
  std::int64_t part_end(std::int64_t first, std::int64_t last) const;

  /// Hits of the rays of a run of groups that `part_end` gave.
  void hits(std::int64_t first_group, std::int64_t last_group, bool incidence, HitBatch& out) const;

  /// Names the rays of such a run that may meet a body, near ones together.
  void select(std::int64_t first_group, std::int64_t last_group, const BodyIndex& bodies,
              std::vector<std::uint32_t>& selected) const;

  std::size_t bytes() const;

 private:
  void cast_block(const ScanPattern& pattern, std::int64_t block, Raycaster& raycaster,
                  RayBatch& rays, HitBatch& hits);

  std::int64_t groups_;
  std::int64_t group_size_;
  std::int64_t block_groups_;         ///< of a block, whose rays are near each other in `order_`
  std::vector<std::uint32_t> order_;  ///< of the rays of a block: a tile is a packet of it
  std::vector<ViewBounds> tiles_;     ///< of block after block
  std::vector<float> range_m_;
  std::vector<float> cos_incidence_;
  std::vector<std::uint16_t> class_id_;
};

}  // namespace infrasim
