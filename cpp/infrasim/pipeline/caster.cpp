#include "infrasim/pipeline/caster.h"

#include <algorithm>
#include <numeric>

namespace infrasim {

namespace {

constexpr VehicleParts kNoParts{false, false, false, false, false};

// index of a ray's random stream for leaves; lower indices are used for the ray's echoes
constexpr std::uint64_t kLeafStream = 64;

/// Returns the end of the batch of ray groups that begins with group `first`. A group consists of
/// rays that are fired together, such as a column of a spinning LiDAR.
std::int64_t part_end(const ScannerUnit& scanner, std::int64_t first, std::int64_t last) {
  if (scanner.layer) return scanner.layer->part_end(first, last);
  const int group = scanner.pattern.group_size();
  return std::min(last, first + std::max<std::int64_t>(4, kChunkRays / group / 4 * 4));
}

std::span<const std::uint32_t> tile_order(ScannerUnit& scanner, std::int64_t groups) {
  auto& order = scanner.tile_orders[groups];
  if (order.empty()) order = scanner.pattern.tile_order(static_cast<int>(groups));
  return order;
}

}  // namespace

std::size_t Caster::cast(int k, const WorldSlice& slice, const FrameVehicles& vehicles,
                         ScannerUnit& scanner, FrameBuilder& out) {
  const RayRange frame = scanner.rays(k), range = scanner.rays(k, slice.from, slice.to);
  const Rng rng = scanner.stream.at(static_cast<std::uint64_t>(k) + 1);
  const int size = scanner.pattern.group_size();
  const std::int64_t last = range.last / size;
  std::size_t cast = 0;
  for (std::int64_t first = range.first / size, end = 0; first < last; first = end) {
    end = part_end(scanner, first, last);
    const Part part{.scanner = scanner,
                    .vehicles = vehicles,
                    .first = first,
                    .last = end,
                    .start_s = k * scanner.period_s,
                    .frame = rng,
                    .first_ray = static_cast<std::uint64_t>(first * size - frame.first)};
    const auto timed = [&](Stage stage, const auto& work) {
      return StageTimes::measure(times_, stage, work);
    };
    timed(Stage::kMaking, [&] { make_rays(part); });
    cast += timed(Stage::kCasting, [&] { return cast_rays(part); });
    if (part.by_power() && !leaves_.empty()) timed(Stage::kLeaves, [&] { stop_in_leaves(part); });
    if (part.by_power() || scanner.beam)
      cast += timed(Stage::kPanes, [&] { return pass_panes(part); });
    else
      echoes_.take(hits_);
    if (scanner.beam) timed(Stage::kBeam, [&] { merge_beams(part); });
    detect(part, out);
  }
  return cast;
}

/// Makes the rays of a part of the frame. With a static layer, these are only rays that can give a
/// point: rays that may meet a body or leaves, and rays whose static hit can be detected. Rays of
/// the second kind get their direction later, in make_returned_rays.
void Caster::make_rays(const Part& part) {
  const ScannerUnit& scanner = part.scanner;
  const int size = scanner.pattern.group_size();
  rays_.max_range = scanner.max_range;
  if (!scanner.layer)
    return scanner.pattern.generate({part.first * size, part.last * size}, part.start_s, rays_);
  const StaticLayer& layer = *scanner.layer;
  layer.select(part.first, part.last, raycaster_.bodies(), selected_);
  in_leaves_.clear();
  if (part.by_power() && !layer.knows_leaves())
    layer.select(part.first, part.last, leaves_.index(), in_leaves_);
  layer.candidates(part.first, part.last, static_);
  if (loses_rays(part))
    for (auto* numbers : {&selected_, &in_leaves_, &static_}) leave_out_lost(part, *numbers);
  dynamic_ = selected_;
  dynamic_.insert(dynamic_.end(), in_leaves_.begin(), in_leaves_.end());
  std::ranges::sort(dynamic_);
  dynamic_.erase(std::ranges::unique(dynamic_).begin(), dynamic_.end());
  position_.resize(static_cast<std::size_t>(part.groups() * size));
  rays_.number.clear();
  auto candidate = static_.begin();
  for (std::uint32_t& dynamic : dynamic_) {
    while (candidate != static_.end() && *candidate < dynamic) rays_.number.push_back(*candidate++);
    if (candidate != static_.end() && *candidate == dynamic) ++candidate;
    rays_.number.push_back(dynamic);
    position_[dynamic] = static_cast<std::uint32_t>(rays_.number.size() - 1);
    dynamic = position_[dynamic];
  }
  rays_.number.insert(rays_.number.end(), candidate, static_.end());
  for (auto* some : {&selected_, &in_leaves_})
    for (std::uint32_t& i : *some) i = position_[i];
  rays_.resize(rays_.number.size());
  if (scanner.returns.has_channels()) scanner.pattern.set_rings(rays_);
  scanner.pattern.generate(part.first, part.start_s, dynamic_, rays_);
}

/// Computes the directions of rays that gave a point but have no direction yet.
void Caster::make_returned_rays(const Part& part) {
  if (!part.scanner.layer) return;
  static_.clear();
  auto dynamic = dynamic_.begin();
  for (const std::uint32_t echo : returns_.echo) {
    if (echo >= rays_.size()) continue;  // a weaker echo; its ray already has a direction
    while (dynamic != dynamic_.end() && *dynamic < echo) ++dynamic;
    if (dynamic == dynamic_.end() || *dynamic != echo) static_.push_back(echo);
  }
  part.scanner.pattern.generate(part.first, part.start_s, static_, rays_);
}

/// Finds the nearest hit of each ray and, for wide beams, the hits of their sub-rays.
/// @return number of rays cast
std::size_t Caster::cast_rays(const Part& part) {
  const ScannerUnit& scanner = part.scanner;
  if (scanner.layer)
    take_static_hits(part);
  else
    select(part);
  if (scanner.beam) return cast_beams(part);
  if (scanner.layer)
    raycaster_.cast_bodies(rays_, selected_, hits_, part.by_power());
  else
    raycaster_.cast(rays_, selected_, hits_, part.by_power());
  return selected_.size();
}

/// Returns whether rays can be lost at random, independently of the surface that they meet.
bool Caster::loses_rays(const Part& part) const {
  const ScannerUnit& scanner = part.scanner;
  return scanner.returns.loses_rays() && scanner.returns.echo_mode() == EchoMode::kStrongest &&
         !(scanner.layer && scanner.layer->has_recorded());
}

/// Removes the rays that are lost at random and therefore need not be cast.
/// @param numbers numbers of rays of the part
void Caster::leave_out_lost(const Part& part, std::vector<std::uint32_t>& numbers) const {
  std::erase_if(numbers, [&](std::uint32_t number) {
    return part.scanner.returns.loses(part.frame.at(part.first_ray + number));
  });
}

/// Selects the rays that must be cast, with neighbouring rays together. Rays above all objects in
/// the scene are not selected.
void Caster::select(const Part& part) {
  if (bodies_only_) return select_for_bodies(part);
  ScannerUnit& scanner = part.scanner;
  const float spread = scanner.half_width();
  const bool leaves =
      scanner.beam && scanner.beam->everywhere() && part.by_power() && !leaves_.empty();
  const auto below = [&](const Horizon& horizon, std::uint32_t i) {
    return horizon.covers(rays_.dx[i], rays_.dy[i], rays_.dz[i], spread);
  };
  selected_.clear();
  for (const std::uint32_t i : tile_order(scanner, part.groups()))
    if (below(raycaster_.horizon(), i) || (leaves && below(leaves_.horizon(), i)))
      selected_.push_back(i);
  if (loses_rays(part)) leave_out_lost(part, selected_);
}

/// Selects the tiles (packets of neighbouring rays) in which a ray may meet a moving body.
void Caster::select_for_bodies(const Part& part) {
  ScannerUnit& scanner = part.scanner;
  const float spread = scanner.half_width();
  selected_.clear();
  for_each_packet(tile_order(scanner, part.groups()), [&](std::span<const std::uint32_t> tile) {
    ViewBounds view;
    for (const std::uint32_t i : tile) view.add_cone(rays_.dx[i], rays_.dy[i], rays_.dz[i], spread);
    if (raycaster_.bodies().any_in(view))
      selected_.insert(selected_.end(), tile.begin(), tile.end());
  });
  if (loses_rays(part)) leave_out_lost(part, selected_);
}

/// Copies the hits of the static layer to the hits of the rays. The stored gain becomes the cosine
/// of incidence, although the gain of a recorded surface is an intensity.
void Caster::take_static_hits(const Part& part) {
  const StaticSlice layer = part.scanner.layer->slice(part.first, part.last, rays_.number);
  hits_.resize(rays_.size());
  for (std::size_t k = 0; k < rays_.size(); ++k) {
    const std::uint32_t i = layer.number[k];
    hits_.range[k] = layer.range_m[i];
    hits_.cos_incidence[k] = layer.gain[i];
    hits_.class_id[k] = layer.class_id[i];
    hits_.object[k] = -1;
  }
}

/// Replaces the hits of rays and of sub-rays that leaves stop.
void Caster::stop_in_leaves(const Part& part) {
  if (part.scanner.beam) {
    sub_order_.resize(sub_rays_.size());
    std::iota(sub_order_.begin(), sub_order_.end(), 0U);
    leaves_.stop(
        sub_rays_, sub_order_,
        [&](std::uint32_t k) {
          return part.frame.at(part.first_ray + rays_.number[beams_[sub_[k].beam]])
              .at(kLeafStream + sub_number_[k]);
        },
        sub_hits_);
    if (part.scanner.beam->everywhere()) return;
  }
  if (part.scanner.layer && part.scanner.layer->knows_leaves()) {
    const std::uint32_t first = part.scanner.layer->first_ray(part.first);
    std::uint32_t k = 0;
    for (const Volumes::RayWay& way : part.scanner.layer->leaf_ways(part.first, part.last)) {
      const std::uint32_t number = way.ray - first;
      while (k < rays_.size() && rays_.number[k] < number) ++k;
      if (k == rays_.size()) break;
      if (rays_.number[k] != number) continue;  // rays outside the batch give no point
      if (way.way.from < std::min(hits_.range[k], rays_.max_range))
        leaves_.stop_in(way, part.frame.at(part.first_ray + number).at(kLeafStream), k,
                        rays_.max_range, hits_);
    }
    return;
  }
  const auto rng_of = [&](std::uint32_t k) {
    return part.frame.at(part.first_ray + rays_.number[k]).at(kLeafStream);
  };
  leaves_.stop(rays_, order_for_leaves(part), rng_of, hits_);
}

/// Returns the rays without sub-rays that may meet leaves, including rays that are not cast.
std::span<const std::uint32_t> Caster::order_for_leaves(const Part& part) {
  if (bodies_only_) return selected_;
  if (part.scanner.layer) return in_leaves_;
  return tile_order(part.scanner, part.groups());
}

/// Makes echoes from the hits, including echoes of surfaces behind window panes and below vehicles.
/// @return number of rays that were cast again behind a pane or below a vehicle
std::size_t Caster::pass_panes(const Part& part) {
  const ScannerUnit& scanner = part.scanner;
  const StaticSlice background =
      scanner.layer ? scanner.layer->slice(part.first, part.last, rays_.number) : StaticSlice{};
  const VehicleParts& parts = part.by_power() ? parts_ : kNoParts;
  const std::size_t cast = transparent_.resolve(rays_, part.vehicles, parts, scanner.returns.path(),
                                                hits_, echoes_, background);
  if (!scanner.beam) return cast;
  beam_of_.clear();
  for (const SubRay& sub : sub_) beam_of_.push_back(sub.beam);
  return cast + transparent_.resolve(
                    sub_rays_, part.vehicles, parts, scanner.returns.path(), sub_hits_, sub_echoes_,
                    scanner.beam->everywhere() ? StaticSlice{} : static_hits_of_beams(), &weaker_);
}

}  // namespace infrasim
