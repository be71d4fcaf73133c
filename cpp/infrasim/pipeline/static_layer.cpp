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

/// Bytes per ray, on average, that ways through leaves may take.
constexpr std::size_t kLeafBytes = 12;

/// Number of groups in a block of neighbouring rays.
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

}  // namespace

std::size_t layer_bytes(const ScanPattern& pattern) {
  constexpr std::size_t kRayBytes =
      2 * sizeof(float) + sizeof(std::uint16_t) + sizeof(std::uint32_t) + kLeafBytes;
  constexpr std::size_t kTileBytes = 2;  // bytes per ray for the view of a tile of 8 or more rays
  const auto rays = static_cast<std::size_t>(pattern.repeats_after() * pattern.group_size());
  return rays * (kRayBytes + kTileBytes);
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
                         const Volumes& leaves)
    : hits_(std::move(hits)),
      block_groups_(block_groups(hits_.group_size)),
      order_(pattern.tile_order(static_cast<int>(block_groups_))),
      knows_leaves_(returns.needs_reflectance()) {
  const std::size_t most_ways = hits_.rays() * kLeafBytes / sizeof(Volumes::RayWay);
  RayBatch rays;
  rays.max_range = hits_.max_range_m;
  std::vector<std::uint32_t> order, leaf_candidates;
  std::size_t first = 0;
  EchoBatch echoes;
  std::vector<std::uint16_t> rings;
  const auto add_candidates = [&](const EchoBatch& of, std::span<const std::uint16_t> ring,
                                  const auto& number, std::vector<std::uint32_t>& to) {
    const std::vector<bool> can = returns.can_return(of, ring);
    for (std::size_t i = 0; i < can.size(); ++i)
      if (can[i]) to.push_back(static_cast<std::uint32_t>(number(i)));
  };
  for_each_block(pattern, rays, [&](const RayBatch& block) {
    order.clear();
    for (std::size_t i = 0; i < order_.size(); ++i) {
      if (i % kTileRays == 0) tiles_.emplace_back();
      const std::uint32_t k = order_[i];
      if (k >= block.size()) continue;
      tiles_.back().add(block.dx[k], block.dy[k], block.dz[k]);
      order.push_back(k);
    }
    echoes.resize(block.size());
    for (std::size_t i = 0; i < block.size(); ++i) {
      const auto material = static_cast<Class>(hits_.class_id[first + i]);
      echoes.set(i, {hits_.range_m[first + i], -1, hits_.class_id[first + i],
                     background_reflectance(material), hits_.gain[first + i]});
    }
    add_candidates(echoes, block.ring, [&](std::size_t i) { return first + i; }, candidates_);
    if (knows_leaves_) {
      const std::size_t before = leaf_ways_.size();
      leaves.for_each_way(block, order, std::span(hits_.range_m).subspan(first, block.size()),
                          [&](Volumes::RayWay way) {
                            way.ray += static_cast<std::uint32_t>(first);
                            leaf_ways_.push_back(leaves.with_limit(way));
                          });
      std::stable_sort(leaf_ways_.begin() + static_cast<std::ptrdiff_t>(before), leaf_ways_.end(),
                       [](const auto& a, const auto& b) { return a.ray < b.ray; });
      echoes.resize(leaf_ways_.size() - before);
      rings.resize(echoes.size());
      for (std::size_t i = 0; i < echoes.size(); ++i) {
        const Volumes::RayWay& way = leaf_ways_[before + i];
        rings[i] = block.ring[way.ray - first];
        const float nearest = returns.nearest(static_cast<float>(way.way.from), rings[i]);
        echoes.set(i, {nearest, -1, static_cast<std::uint16_t>(Class::kVegetation),
                       background_reflectance(Class::kVegetation), 1});
      }
      add_candidates(
          echoes, rings, [&](std::size_t i) { return leaf_ways_[before + i].ray; },
          leaf_candidates);
      knows_leaves_ = leaf_ways_.size() <= most_ways;
    }
    first += block.size();
  });
  if (!knows_leaves_) leaf_ways_.clear();
  leaf_ways_.shrink_to_fit();
  const auto surfaces = static_cast<std::ptrdiff_t>(candidates_.size());
  std::ranges::sort(leaf_candidates);
  if (knows_leaves_)
    candidates_.insert(candidates_.end(), leaf_candidates.begin(), leaf_candidates.end());
  std::ranges::inplace_merge(candidates_, candidates_.begin() + surfaces);
  candidates_.erase(std::ranges::unique(candidates_).begin(), candidates_.end());
  candidates_.shrink_to_fit();
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

std::span<const std::uint32_t> StaticLayer::candidates(std::int64_t first_group,
                                                       std::int64_t last_group) const {
  const std::uint32_t first = first_ray(first_group);
  const auto rays = static_cast<std::uint32_t>((last_group - first_group) * hits_.group_size);
  return {std::ranges::lower_bound(candidates_, first),
          std::ranges::lower_bound(candidates_, first + rays)};
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
         candidates_.size() * sizeof(std::uint32_t) + tiles_.size() * sizeof(ViewBounds) +
         leaf_ways_.size() * sizeof(Volumes::RayWay);
}

}  // namespace infrasim
