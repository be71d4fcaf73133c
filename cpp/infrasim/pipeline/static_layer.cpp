#include "infrasim/pipeline/static_layer.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

#include "infrasim/core/classes.h"
#include "infrasim/core/rng.h"
#include "infrasim/sensor/echoes.h"
#include "infrasim/sensor/reflectance.h"

namespace infrasim {

namespace {

constexpr std::int64_t kTileRays = kPacketRays;
constexpr std::int64_t kLeastColumns =
    4;  // minimum number of columns in a block, so that a tile is as wide as it is high

/// Maximum memory for the paths of rays through leaves: mean bytes per ray, and bytes of all rays.
constexpr std::size_t kLeafBytes = 12, kMostLeafBytes = std::size_t{16} << 20;

constexpr std::size_t kWordBits = 64;

/// Returns the number of ray groups in a block of neighbouring rays.
std::int64_t block_groups(std::int64_t group_size) {
  return std::max(kLeastColumns, kTileRays / group_size);
}

/// Calls use(rays) for each block of a period.
template <class Use>
void for_each_block(const ScanPattern& pattern, RayBatch& rays, const Use& use) {
  const std::int64_t size = pattern.group_size(), step = block_groups(size);
  for (std::int64_t first = 0; first < pattern.repeats_after(); first += step) {
    const std::int64_t last = std::min(first + step, pattern.repeats_after());
    pattern.generate({first * size, last * size}, 0, rays);
    use(rays);
  }
}

std::size_t leaf_bytes(std::size_t rays) { return std::min(rays * kLeafBytes, kMostLeafBytes); }

std::size_t words_of(std::size_t rays) { return (rays + kWordBits - 1) / kWordBits; }

}  // namespace

std::size_t layer_bytes(const ScanPattern& pattern) {
  constexpr std::size_t kRayBytes = 2 * sizeof(float) + sizeof(std::uint16_t);
  constexpr std::size_t kTileBytes = 2;  // bytes per ray for the bounds of a tile of 8 or more rays
  const auto rays = static_cast<std::size_t>(pattern.repeats_after() * pattern.group_size());
  return rays * (kRayBytes + kTileBytes) + words_of(rays) * sizeof(std::uint64_t) +
         leaf_bytes(rays);
}

StaticHits no_hits(const ScanPattern& pattern, float max_range_m) {
  StaticHits out{
      .groups = pattern.repeats_after(),
      .group_size = pattern.group_size(),
      .max_range_m = max_range_m,
      .directions = 0,
      .range_m = {},
      .gain = {},
      .class_id = {},
  };
  RayBatch rays;
  for_each_block(pattern, rays, [&](const RayBatch& block) {
    for (std::size_t i = 0; i < block.size(); ++i)
      for (const float v : {block.dx[i], block.dy[i], block.dz[i]})
        out.directions = mix64(out.directions ^ std::bit_cast<std::uint32_t>(v));
  });
  out.range_m.assign(out.rays(), std::numeric_limits<float>::infinity());
  out.gain.assign(out.rays(), 0);
  out.class_id.assign(out.rays(), 0);
  return out;
}

StaticHits cast_static(const ScanPattern& pattern, float max_range_m, Raycaster& raycaster) {
  StaticHits out = no_hits(pattern, max_range_m);
  const std::vector<std::uint32_t> tiles =
      pattern.tile_order(static_cast<int>(block_groups(out.group_size)));
  RayBatch rays;
  rays.max_range = max_range_m;
  HitBatch hits;
  std::vector<std::uint32_t> order;
  std::size_t from = 0;
  for_each_block(pattern, rays, [&](const RayBatch& block) {
    order.clear();
    std::ranges::copy_if(tiles, std::back_inserter(order),
                         [&](std::uint32_t i) { return i < block.size(); });
    raycaster.cast_background(block, order, hits);
    for (std::size_t i = 0; i < block.size(); ++i, ++from) {
      if (!std::isfinite(hits.range[i])) continue;
      out.range_m[from] = hits.range[i];
      out.gain[from] = hits.cos_incidence[i];
      out.class_id[from] = hits.class_id[i];
    }
  });
  return out;
}

StaticLayer::StaticLayer(const ScanPattern& pattern, StaticHits hits, const ReturnModel& returns,
                         const Volumes& leaves, float half_width)
    : hits_(std::move(hits)),
      block_groups_(block_groups(hits_.group_size)),
      order_(pattern.tile_order(static_cast<int>(block_groups_))),
      candidates_(words_of(hits_.rays())),
      knows_leaves_(returns.needs_reflectance()) {
  has_recorded_ = std::ranges::find(hits_.class_id, static_cast<std::uint16_t>(Class::kRecorded)) !=
                  hits_.class_id.end();
  const std::size_t most_ways = leaf_bytes(hits_.rays()) / sizeof(Volumes::RayWay);
  RayBatch rays;
  rays.max_range = hits_.max_range_m;
  std::vector<std::uint32_t> leaf_candidates;
  std::size_t first = 0;
  for_each_block(pattern, rays, [&](const RayBatch& block) {
    add_tiles(block, half_width);
    mark_surfaces(block, first, returns);
    if (knows_leaves_) add_leaf_ways(block, first, returns, leaves, leaf_candidates);
    knows_leaves_ = knows_leaves_ && leaf_ways_.size() <= most_ways;
    first += block.size();
  });
  if (!knows_leaves_) leaf_ways_.clear();
  leaf_ways_.shrink_to_fit();
  if (knows_leaves_)
    for (const std::uint32_t ray : leaf_candidates) mark(ray);
}

void StaticLayer::add_tiles(const RayBatch& block, float half_width) {
  for (std::size_t i = 0; i < order_.size(); ++i) {
    if (i % kTileRays == 0) tiles_.emplace_back();
    const std::uint32_t k = order_[i];
    if (k < block.size()) tiles_.back().add_cone(block.dx[k], block.dy[k], block.dz[k], half_width);
  }
}

void StaticLayer::mark(std::size_t ray) {
  candidates_[ray / kWordBits] |= std::uint64_t{1} << (ray % kWordBits);
}

/// Marks the rays of a block that can give a point of a static surface.
/// @param first number of the block's first ray in the period
void StaticLayer::mark_surfaces(const RayBatch& block, std::size_t first,
                                const ReturnModel& returns) {
  EchoBatch echoes;
  echoes.resize(block.size());
  for (std::size_t i = 0; i < block.size(); ++i) {
    const std::uint16_t material = hits_.class_id[first + i];
    echoes.set(i, {hits_.range_m[first + i], -1, material,
                   background_reflectance(static_cast<Class>(material)), hits_.gain[first + i]});
  }
  const std::vector<bool> can = returns.can_return(echoes, block.ring);
  for (std::size_t i = 0; i < can.size(); ++i)
    if (can[i]) mark(first + i);
}

/// Stores the paths of a block's rays through leaves. Adds the rays that can give a point of leaves
/// to `candidates`.
void StaticLayer::add_leaf_ways(const RayBatch& block, std::size_t first,
                                const ReturnModel& returns, const Volumes& leaves,
                                std::vector<std::uint32_t>& candidates) {
  std::vector<std::uint32_t> order;
  std::ranges::copy_if(order_, std::back_inserter(order),
                       [&](std::uint32_t i) { return i < block.size(); });
  std::vector<Volumes::RayWay> ways;
  leaves.for_each_way(block, order, std::span(hits_.range_m).subspan(first, block.size()),
                      [&](const Volumes::RayWay& way) { ways.push_back(leaves.with_limit(way)); });
  std::ranges::stable_sort(ways, {}, &Volumes::RayWay::ray);
  EchoBatch echoes;
  echoes.resize(ways.size());
  std::vector<std::uint16_t> rings(ways.size());
  for (std::size_t i = 0; i < ways.size(); ++i) {
    rings[i] = block.ring[ways[i].ray];
    const float nearest = returns.nearest(static_cast<float>(ways[i].way.from), rings[i]);
    echoes.set(i, {nearest, -1, static_cast<std::uint16_t>(Class::kVegetation),
                   background_reflectance(Class::kVegetation), 1});
    ways[i].ray += static_cast<std::uint32_t>(first);
  }
  const std::vector<bool> can = returns.can_return(echoes, rings);
  for (std::size_t i = 0; i < can.size(); ++i)
    if (can[i]) candidates.push_back(ways[i].ray);
  leaf_ways_.insert(leaf_ways_.end(), ways.begin(), ways.end());
}

std::int64_t StaticLayer::part_end(std::int64_t first, std::int64_t last) const {
  const std::int64_t period = first / hits_.groups * hits_.groups, within = first - period;
  const std::int64_t blocks =
      std::max<std::int64_t>(1, kChunkRays / (block_groups_ * hits_.group_size));
  const std::int64_t step = blocks * block_groups_;
  return std::min({last, period + (within / step + 1) * step, period + hits_.groups});
}

StaticSlice StaticLayer::slice(std::int64_t first_group, std::int64_t last_group,
                               std::span<const std::uint32_t> number) const {
  const auto n = static_cast<std::size_t>((last_group - first_group) * hits_.group_size);
  const auto part = [&](const auto& column) {
    return std::span(column).subspan(first_ray(first_group), n);
  };
  return {part(hits_.range_m), part(hits_.gain), part(hits_.class_id), number};
}

void StaticLayer::candidates(std::int64_t first_group, std::int64_t last_group,
                             std::vector<std::uint32_t>& out) const {
  out.clear();
  const std::size_t from = first_ray(first_group);
  const std::size_t to =
      from + static_cast<std::size_t>((last_group - first_group) * hits_.group_size);
  for (std::size_t w = from / kWordBits; w * kWordBits < to; ++w) {
    std::uint64_t word = candidates_[w];
    if (w * kWordBits < from) word &= ~std::uint64_t{0} << (from % kWordBits);
    if ((w + 1) * kWordBits > to) word &= ~(~std::uint64_t{0} << (to % kWordBits));
    for (; word != 0; word &= word - 1)
      out.push_back(static_cast<std::uint32_t>(
          w * kWordBits + static_cast<std::size_t>(std::countr_zero(word)) - from));
  }
}

std::span<const Volumes::RayWay> StaticLayer::leaf_ways(std::int64_t first_group,
                                                        std::int64_t last_group) const {
  const std::uint32_t first = first_ray(first_group);
  const auto rays = static_cast<std::uint32_t>((last_group - first_group) * hits_.group_size);
  const auto from = std::ranges::lower_bound(leaf_ways_, first, {}, &Volumes::RayWay::ray);
  const auto to = std::ranges::lower_bound(leaf_ways_, first + rays, {}, &Volumes::RayWay::ray);
  return {from, to};
}

void StaticLayer::select(std::int64_t first_group, std::int64_t last_group, const BodyIndex& bodies,
                         std::vector<std::uint32_t>& selected) const {
  selected.clear();
  const std::int64_t from = first_group % hits_.groups * hits_.group_size;
  const std::int64_t to = from + (last_group - first_group) * hits_.group_size;
  const std::int64_t block_rays = block_groups_ * hits_.group_size;
  const std::int64_t tiles = (block_rays + kTileRays - 1) / kTileRays;
  for (std::int64_t block = from / block_rays; block * block_rays < to; ++block)
    for (std::int64_t t = 0; t < tiles; ++t) {
      if (!bodies.any_in(tiles_[static_cast<std::size_t>(block * tiles + t)])) continue;
      for (std::int64_t i = t * kTileRays; i < std::min((t + 1) * kTileRays, block_rays); ++i) {
        const std::int64_t ray = block * block_rays + order_[static_cast<std::size_t>(i)];
        if (ray >= from && ray < to) selected.push_back(static_cast<std::uint32_t>(ray - from));
      }
    }
}

std::size_t StaticLayer::bytes() const {
  return hits_.rays() * (2 * sizeof(float) + sizeof(std::uint16_t)) +
         candidates_.size() * sizeof(std::uint64_t) + tiles_.size() * sizeof(ViewBounds) +
         leaf_ways_.size() * sizeof(Volumes::RayWay);
}

}  // namespace infrasim
