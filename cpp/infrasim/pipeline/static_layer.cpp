#include "infrasim/pipeline/static_layer.h"

#include <algorithm>

namespace infrasim {

namespace {

constexpr std::int64_t kTile = kPacketRays;
constexpr std::int64_t kLeastColumns = 4;  // of a block: as wide as tiles are high

}  // namespace

StaticLayer::StaticLayer(const ScanPattern& pattern, float max_range_m, Raycaster& raycaster)
    : groups_(pattern.repeats_after()),
      group_size_(pattern.group_size()),
      block_groups_(std::max(kLeastColumns, kTile / group_size_)),
      order_(pattern.tile_order(static_cast<int>(block_groups_))) {
  const auto rays = static_cast<std::size_t>(groups_ * group_size_);
  range_m_.reserve(rays);
  cos_incidence_.reserve(rays);
  class_id_.reserve(rays);
  RayBatch batch;
  batch.max_range = max_range_m;
  HitBatch hits;
  for (std::int64_t block = 0; block * block_groups_ < groups_; ++block)
    cast_block(pattern, block, raycaster, batch, hits);
}

void StaticLayer::cast_block(const ScanPattern& pattern, std::int64_t block, Raycaster& raycaster,
                             RayBatch& rays, HitBatch& hits) {
  const std::int64_t first = block * block_groups_;
  const std::int64_t last = std::min(first + block_groups_, groups_);
  pattern.generate({first * group_size_, last * group_size_}, 0, rays);
  std::vector<std::uint32_t> order;
  for (std::size_t i = 0; i < order_.size(); ++i) {
    if (i % kTile == 0) tiles_.emplace_back();
    if (order_[i] >= rays.size()) continue;
    order.push_back(order_[i]);
    tiles_.back().add(rays.dx[order_[i]], rays.dy[order_[i]], rays.dz[order_[i]]);
  }
  raycaster.cast_background(rays, order, hits);
  range_m_.insert(range_m_.end(), hits.range.begin(), hits.range.end());
  cos_incidence_.insert(cos_incidence_.end(), hits.cos_incidence.begin(), hits.cos_incidence.end());
  class_id_.insert(class_id_.end(), hits.class_id.begin(), hits.class_id.end());
}

std::int64_t StaticLayer::part_end(std::int64_t first, std::int64_t last) const {
  const std::int64_t period = first / groups_ * groups_, within = first - period;
  const std::int64_t blocks = std::max<std::int64_t>(1, kChunkRays / (block_groups_ * group_size_));
  const std::int64_t step = blocks * block_groups_;
  return std::min({last, period + (within / step + 1) * step, period + groups_});
}

void StaticLayer::hits(std::int64_t first_group, std::int64_t last_group, bool incidence,
                       HitBatch& out) const {
  const std::int64_t from = first_group % groups_ * group_size_;
  const std::int64_t n = (last_group - first_group) * group_size_;
  out.resize(static_cast<std::size_t>(n));
  std::copy_n(range_m_.begin() + from, n, out.range.begin());
  std::copy_n(class_id_.begin() + from, n, out.class_id.begin());
  if (incidence) std::copy_n(cos_incidence_.begin() + from, n, out.cos_incidence.begin());
  std::ranges::fill(out.object, -1);
}

void StaticLayer::select(std::int64_t first_group, std::int64_t last_group, const BodyIndex& bodies,
                         std::vector<std::uint32_t>& selected) const {
  selected.clear();
  const std::int64_t from = first_group % groups_ * group_size_;
  const std::int64_t to = from + (last_group - first_group) * group_size_;
  const std::int64_t block_rays = block_groups_ * group_size_;
  const std::int64_t tiles = (block_rays + kTile - 1) / kTile;
  for (std::int64_t block = from / block_rays; block * block_rays < to; ++block)
    for (std::int64_t t = 0; t < tiles; ++t) {
      if (!bodies.any_in(tiles_[static_cast<std::size_t>(block * tiles + t)])) continue;
      for (std::int64_t i = t * kTile; i < std::min((t + 1) * kTile, block_rays); ++i) {
        const std::int64_t ray = block * block_rays + order_[static_cast<std::size_t>(i)];
        if (ray >= from && ray < to) selected.push_back(static_cast<std::uint32_t>(ray - from));
      }
    }
}

std::size_t StaticLayer::bytes() const {
  return range_m_.size() * (2 * sizeof(float) + sizeof(std::uint16_t)) +
         tiles_.size() * sizeof(ViewBounds);
}

}  // namespace infrasim
