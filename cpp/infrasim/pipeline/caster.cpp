#include "infrasim/pipeline/caster.h"

#include <algorithm>
#include <iterator>
#include <limits>
#include <numeric>

#include "infrasim/sensor/pattern_table.h"

namespace infrasim {

namespace {

constexpr VehicleParts kNoParts{false, false, false, false, false};

// offset of a ray's random numbers for leaves, which follow its other samples
constexpr std::uint64_t kLeafStream = 16;

/// Returns the end of the part of the frame that begins with group `first` and is processed at
/// once.
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

RayRange ScannerUnit::rays(int k, double from, double to) const {
  return pattern.fired_between((k + from) * period_s, (k + to) * period_s);
}

Mat3 unit_pose(const SceneConfig& scene, const LidarUnit& unit) {
  const MountConfig& mount = scene.mounts.begin()->second;
  return rotation(0, rad(mount.pitch_deg), rad(mount.roll_deg)) *
         rotation(rad(unit.yaw_deg), rad(unit.pitch_deg), 0);
}

namespace {

/// @param unit       index in the LiDAR's units
/// @param first_ring ring number of the unit's lowest laser
ScannerUnit make_scanner_unit(const SceneConfig& scene, const LidarConfig& lidar, std::size_t unit,
                              int first_ring, const std::string& stream_prefix) {
  const LidarUnit& config = lidar.units[unit];
  const Mat3 pose = unit_pose(scene, config);
  const auto& [name, mount] = *scene.mounts.begin();
  const std::string mount_prefix =
      mount.own_random_stream.value_or(false) ? "mount " + name + " " : "";
  const auto& beam = config.returns.beam;
  const auto& spinning = config.pattern.spinning;
  const std::vector<Channel> channels =
      spinning ? channels_by_ring(*spinning) : std::vector<Channel>{};
  return {
      ScanPattern(config.pattern, start_phase_s(scene.seed, name, lidar, unit), pose, first_ring),
      ReturnModel(config.returns, scene.weather, channels, first_ring),
      beam ? std::optional<Beam>(Beam(*beam, pose)) : std::nullopt,
      static_cast<float>(config.returns.max_range_m),
      period_s(config.pattern),
      Rng::of(scene.seed, stream_prefix + mount_prefix + stream_name(lidar, unit)),
      {},
      {}};
}

}  // namespace

std::vector<ScannerUnit> make_scanner_units(const SceneConfig& scene, const LidarConfig& lidar,
                                            const std::string& stream_prefix) {
  std::vector<ScannerUnit> scanners;
  int first_ring = 0;
  for (std::size_t i = 0; i < lidar.units.size(); ++i) {
    scanners.push_back(make_scanner_unit(scene, lidar, i, first_ring, stream_prefix));
    first_ring += scanners.back().pattern.rings();
  }
  return scanners;
}

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

/// Makes the rays of a part. Of a unit with a static layer, the batch has only rays that can give a
/// point: those that may meet a body, and the candidates of the layer. Only rays that may meet
/// something that the layer does not have get a direction now.
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
  dynamic_ = selected_;
  dynamic_.insert(dynamic_.end(), in_leaves_.begin(), in_leaves_.end());
  std::ranges::sort(dynamic_);
  dynamic_.erase(std::ranges::unique(dynamic_).begin(), dynamic_.end());
  position_.resize(static_cast<std::size_t>(part.groups() * size));
  rays_.number.clear();
  layer.candidates(part.first, part.last, static_);
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

/// Makes the rays that gave a point and do not have a direction yet.
void Caster::make_returned_rays(const Part& part) {
  if (!part.scanner.layer) return;
  static_.clear();
  std::ranges::set_difference(returns_.ray, dynamic_, std::back_inserter(static_));
  part.scanner.pattern.generate(part.first, part.start_s, static_, rays_);
}

/// Finds the nearest hits of the rays, or of the sub-rays of beams.
/// @return number of rays cast
std::size_t Caster::cast_rays(const Part& part) {
  const ScannerUnit& scanner = part.scanner;
  if (scanner.layer) {
    take_static_hits(part);
    raycaster_.cast_bodies(rays_, selected_, hits_, part.by_power());
    return selected_.size();
  }
  select(part);
  if (!scanner.beam) {
    raycaster_.cast(rays_, selected_, hits_, part.by_power());
    return selected_.size();
  }
  scanner.beam->expand(rays_, selected_, sub_rays_);
  sub_selected_.resize(sub_rays_.size());
  std::iota(sub_selected_.begin(), sub_selected_.end(), 0U);
  raycaster_.cast(sub_rays_, sub_selected_, hits_, true);
  return sub_rays_.size();
}

/// Selects the rays that must be cast, with neighbouring rays together. Rays above all objects in
/// the scene are not selected.
void Caster::select(const Part& part) {
  if (bodies_only_) return select_for_bodies(part);
  ScannerUnit& scanner = part.scanner;
  const float spread = scanner.beam ? scanner.beam->half_width() : 0;
  const bool leaves = scanner.beam && part.by_power() && !leaves_.empty();
  const auto below = [&](const Horizon& horizon, std::uint32_t i) {
    return horizon.covers(rays_.dx[i], rays_.dy[i], rays_.dz[i], spread);
  };
  selected_.clear();
  for (const std::uint32_t i : tile_order(scanner, part.groups()))
    if (below(raycaster_.horizon(), i) || (leaves && below(leaves_.horizon(), i)))
      selected_.push_back(i);
}

/// Selects the tiles of rays that may meet a body.
void Caster::select_for_bodies(const Part& part) {
  ScannerUnit& scanner = part.scanner;
  const float spread = scanner.beam ? scanner.beam->half_width() : 0;
  const std::span<const std::uint32_t> order = tile_order(scanner, part.groups());
  selected_.clear();
  for (std::size_t from = 0; from < order.size(); from += kPacketRays) {
    const auto tile = order.subspan(from, std::min<std::size_t>(kPacketRays, order.size() - from));
    ViewBounds view;
    for (const std::uint32_t i : tile) view.add_cone(rays_.dx[i], rays_.dy[i], rays_.dz[i], spread);
    if (raycaster_.bodies().any_in(view))
      selected_.insert(selected_.end(), tile.begin(), tile.end());
  }
}

/// Sets the hits of the rays to those of the static layer. The gain becomes the cosine of
/// incidence, also of recorded surfaces, whose gain is not a cosine.
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

const RayBatch& Caster::rays_cast(const Part& part) const {
  return part.scanner.beam ? sub_rays_ : rays_;
}

/// Replaces the hits of rays that leaves stop.
void Caster::stop_in_leaves(const Part& part) {
  if (part.scanner.layer && part.scanner.layer->knows_leaves()) {
    const std::uint32_t first = part.scanner.layer->first_ray(part.first);
    std::uint32_t k = 0;
    for (const Volumes::RayWay& way : part.scanner.layer->leaf_ways(part.first, part.last)) {
      const std::uint32_t number = way.ray - first;
      while (k < rays_.size() && rays_.number[k] < number) ++k;
      if (k == rays_.size()) break;
      if (rays_.number[k] != number) continue;  // the ray gives no point
      if (way.way.from < std::min(hits_.range[k], rays_.max_range))
        leaves_.stop_in(way, part.frame.at(part.first_ray + number).at(kLeafStream), k,
                        rays_.max_range, hits_);
    }
    return;
  }
  const auto width =
      part.scanner.beam ? static_cast<std::uint32_t>(part.scanner.beam->sub_rays()) : 0;
  const auto rng_of = [&](std::uint32_t k) {
    const std::uint32_t ray = width > 0 ? selected_[k / width] : k,
                        sub_ray = width > 0 ? k % width : 0;
    return part.frame.at(part.first_ray + rays_.number[ray]).at(kLeafStream + sub_ray);
  };
  leaves_.stop(rays_cast(part), order_for_leaves(part), rng_of, hits_);
}

/// Returns the rays that may meet leaves. They include rays that are not cast.
std::span<const std::uint32_t> Caster::order_for_leaves(const Part& part) {
  if (part.scanner.beam) return sub_selected_;
  if (bodies_only_) return selected_;
  if (part.scanner.layer) return in_leaves_;
  return tile_order(part.scanner, part.groups());
}

/// Makes echoes from the hits, including surfaces behind panes and below bodies.
/// @return number of rays that were cast again behind a pane or below a body
std::size_t Caster::pass_panes(const Part& part) {
  const ScannerUnit& scanner = part.scanner;
  const StaticSlice background =
      scanner.layer ? scanner.layer->slice(part.first, part.last, rays_.number) : StaticSlice{};
  return transparent_.resolve(rays_cast(part), part.vehicles, part.by_power() ? parts_ : kNoParts,
                              scanner.returns.path(), hits_, echoes_, background);
}

/// Merges the echoes of each beam's sub-rays into one.
void Caster::merge_beams(const Part& part) {
  beam_echoes_.resize(rays_.size());
  part.scanner.beam->combine(echoes_, selected_, part.scanner.returns.path(), beam_echoes_,
                             sunlit_);
}

void Caster::detect(const Part& part, FrameBuilder& out) {
  const bool wide = part.scanner.beam.has_value();
  EchoBatch& echoes = wide ? beam_echoes_ : echoes_;
  if (bodies_only_)
    for (std::size_t i = 0; i < echoes.size(); ++i)
      if (echoes.object[i] < 0) echoes.range[i] = std::numeric_limits<float>::infinity();
  StageTimes::measure(times_, Stage::kReturns, [&] {
    part.scanner.returns.apply(part.frame, part.first_ray, echoes,
                               wide ? sunlit_ : echoes.reflectance, rays_.ring, returns_,
                               rays_.number);
  });
  StageTimes::measure(times_, Stage::kMaking, [&] { make_returned_rays(part); });
  StageTimes::measure(times_, Stage::kCollecting,
                      [&] { collect(part.vehicles.moving, wide, echoes, out); });
}

void Caster::collect(std::span<const MovingObject> objects, bool wide, const EchoBatch& echoes,
                     FrameBuilder& out) const {
  out.reserve(returns_.size());
  for (std::size_t n = 0; n < returns_.size(); ++n) {
    const std::uint32_t i = returns_.ray[n];
    const std::int32_t object = echoes.object[i];
    const MovingObject* hit = object < 0 ? nullptr : &objects[static_cast<std::size_t>(object)];
    out.add({rays_.dx[i], rays_.dy[i], rays_.dz[i], returns_.range[n], echoes.range[i], wide,
             returns_.intensity[n], rays_.time[i], rays_.ring[i],
             hit != nullptr ? static_cast<std::uint16_t>(hit->object_class) : echoes.class_id[i],
             object},
            hit != nullptr ? hit->id : -1);
  }
}

}  // namespace infrasim
