#include "infrasim/pipeline/caster.h"

#include <algorithm>
#include <iterator>
#include <numeric>

#include "infrasim/sensor/pattern_table.h"

namespace infrasim {

namespace {

constexpr VehicleParts kNoParts{false, false, false, false, false};

// offset of a ray's random numbers for leaves, which follow the samples of its echoes
constexpr std::uint64_t kLeafStream = 64;

/// Returns the end of the part of the frame that begins with group `first` and is cast as one
/// batch.
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
  const bool one_echo =
      !config.returns.echoes || config.returns.echoes->mode == EchoMode::kStrongest;
  const auto& spinning = config.pattern.spinning;
  const std::vector<Channel> channels =
      spinning ? channels_by_ring(*spinning) : std::vector<Channel>{};
  return {
      ScanPattern(config.pattern, start_phase_s(scene.seed, name, lidar, unit), pose, first_ring),
      ReturnModel(config.returns, scene.weather, channels, first_ring),
      beam || !one_echo ? std::optional<Beam>(Beam(beam, pose)) : std::nullopt,
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

/// Makes the rays of a part. With a static layer, the batch has only rays that can give a point:
/// those that may meet a body or leaves, and the candidates of the layer. Candidates get no
/// direction yet if the layer has all surfaces that they may meet.
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

/// Makes the rays that gave a point and do not have a direction yet.
void Caster::make_returned_rays(const Part& part) {
  if (!part.scanner.layer) return;
  static_.clear();
  auto dynamic = dynamic_.begin();
  for (const std::uint32_t echo : returns_.echo) {
    if (echo >= rays_.size()) continue;  // its ray has a direction
    while (dynamic != dynamic_.end() && *dynamic < echo) ++dynamic;
    if (dynamic == dynamic_.end() || *dynamic != echo) static_.push_back(echo);
  }
  part.scanner.pattern.generate(part.first, part.start_s, static_, rays_);
}

/// Finds the nearest hits of the rays. Beams that meet a moving object become `beams_`, with the
/// hits of their sub-rays.
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

std::size_t Caster::cast_beams(const Part& part) {
  const Beam& beam = *part.scanner.beam;
  std::size_t cast = 0;
  if (!part.scanner.layer) {
    if (beam.everywhere()) beams_.swap(selected_), selected_.clear();
    raycaster_.cast_background(rays_, selected_, hits_, true);
    cast += selected_.size();
  }
  if (!beam.everywhere())
    raycaster_.near_bodies(rays_, selected_, hits_.range, beam.half_width(), beam.from_m(), beams_);
  static_range_m_.clear();
  static_gain_.clear();
  static_class_.clear();
  for (const std::uint32_t i : beams_) {
    static_range_m_.push_back(hits_.range[i]);
    static_gain_.push_back(hits_.cos_incidence[i]);
    static_class_.push_back(hits_.class_id[i]);
  }
  sub_rays_.resize(0);
  std::vector<std::uint32_t> every(beams_.size());
  std::iota(every.begin(), every.end(), 0U);
  if (beam.everywhere()) {
    cast_sub_rays(part, every, 0, beam.sub_rays());
    return cast + sub_rays_.size();
  }
  // Rays without sub-rays can still meet bodies near the sensor.
  auto next = beams_.begin();
  std::erase_if(selected_, [&](std::uint32_t ray) {
    const bool beam_of_ray = next != beams_.end() && *next == ray;
    if (beam_of_ray) ++next;
    return beam_of_ray;
  });
  raycaster_.cast_bodies(rays_, selected_, hits_, true);
  cast_sub_rays(part, every, 0, beam.probes());
  cast += sub_rays_.size() + selected_.size();
  keep_beams_on_bodies(part);
  const std::size_t probes = sub_rays_.size();
  if (beam.probes() < beam.sub_rays())
    cast_sub_rays(part, mixed_beams(part), beam.probes(), beam.sub_rays());
  return cast + sub_rays_.size() - probes;
}

/// Appends sub-rays `from` to `to` - 1 of some beams to `sub_rays_`, with their hits.
/// @param beams positions in `beams_`
void Caster::cast_sub_rays(const Part& part, std::span<const std::uint32_t> beams, std::size_t from,
                           std::size_t to) {
  const Beam& beam = *part.scanner.beam;
  const std::size_t first = sub_rays_.size(), n = to - from;
  std::vector<std::uint32_t> rays;
  for (const std::uint32_t b : beams) rays.push_back(beams_[b]);
  beam.expand(rays_, rays, from, to, sub_rays_);
  sub_.resize(sub_rays_.size());
  sub_number_.resize(sub_rays_.size());
  const std::span<const float> shares =
      from == 0 && to == beam.probes() ? beam.probe_shares() : beam.shares();
  for (std::size_t k = first; k < sub_rays_.size(); ++k) {
    const std::size_t number = from + (k - first) % n;
    sub_[k] = {beams[(k - first) / n], shares[number]};
    sub_number_[k] = static_cast<std::uint8_t>(number);
  }
  if (from > 0)  // the shares of the probes now belong to a beam with all its sub-rays
    for (const std::uint32_t b : beams)
      for (std::size_t j = 0; j < from; ++j) sub_[from * b + j].share = shares[j];
  sub_order_.resize(sub_rays_.size() - first);
  std::iota(sub_order_.begin(), sub_order_.end(), static_cast<std::uint32_t>(first));
  if (beam.everywhere()) return raycaster_.cast(sub_rays_, sub_order_, sub_hits_, true);
  sub_hits_.resize(sub_rays_.size());
  for (std::size_t k = first; k < sub_rays_.size(); ++k) {
    sub_hits_.range[k] = static_range_m_[sub_[k].beam];
    sub_hits_.cos_incidence[k] = static_gain_[sub_[k].beam];
    sub_hits_.class_id[k] = static_class_[sub_[k].beam];
    sub_hits_.object[k] = -1;
  }
  raycaster_.cast_bodies(sub_rays_, sub_order_, sub_hits_, true);
}

/// Removes the beams whose probes meet no moving object. They are cast as one ray.
void Caster::keep_beams_on_bodies(const Part& part) {
  const std::size_t n = part.scanner.beam->probes();
  std::size_t kept = 0;
  for (std::size_t beam = 0; beam < beams_.size(); ++beam) {
    bool any = false;
    for (std::size_t k = n * beam; k < n * (beam + 1); ++k) any = any || sub_hits_.object[k] >= 0;
    if (!any) continue;
    if (kept < beam) {
      beams_[kept] = beams_[beam];
      static_range_m_[kept] = static_range_m_[beam];
      static_gain_[kept] = static_gain_[beam];
      static_class_[kept] = static_class_[beam];
      sub_rays_.move_rows(n * beam, n * kept, n);
      sub_hits_.move_rows(n * beam, n * kept, n);
    }
    ++kept;
  }
  beams_.resize(kept);
  sub_rays_.resize(n * kept);
  sub_hits_.resize(n * kept);
  sub_.resize(n * kept);
}

/// Returns the positions in `beams_` of beams whose probes meet different surfaces.
std::vector<std::uint32_t> Caster::mixed_beams(const Part& part) const {
  const std::size_t n = part.scanner.beam->probes();
  const double separation_m = part.scanner.returns.separation_m();
  std::vector<std::uint32_t> mixed;
  for (std::size_t beam = 0; beam < beams_.size(); ++beam) {
    const std::span objects = std::span(sub_hits_.object).subspan(n * beam, n);
    const auto [low, high] = std::ranges::minmax(std::span(sub_hits_.range).subspan(n * beam, n));
    const bool one = std::ranges::all_of(objects, [&](int o) { return o == objects.front(); });
    if (!one || !(high - low <= separation_m)) mixed.push_back(static_cast<std::uint32_t>(beam));
  }
  return mixed;
}

/// Returns the static hits of the sub-rays. Each sub-ray has the static hit of its beam's ray.
StaticSlice Caster::static_hits_of_beams() const {
  return {static_range_m_, static_gain_, static_class_, beam_of_};
}

/// Whether rays of the part are lost at random, whatever they meet.
bool Caster::loses_rays(const Part& part) const {
  const ScannerUnit& scanner = part.scanner;
  return scanner.returns.loses_rays() && scanner.returns.echo_mode() == EchoMode::kStrongest &&
         !(scanner.layer && scanner.layer->has_recorded());
}

/// Removes the rays that are lost at random, which need not be cast.
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

/// Selects the tiles of rays that may meet a body.
void Caster::select_for_bodies(const Part& part) {
  ScannerUnit& scanner = part.scanner;
  const float spread = scanner.half_width();
  const std::span<const std::uint32_t> order = tile_order(scanner, part.groups());
  selected_.clear();
  for (std::size_t from = 0; from < order.size(); from += kPacketRays) {
    const auto tile = order.subspan(from, std::min<std::size_t>(kPacketRays, order.size() - from));
    ViewBounds view;
    for (const std::uint32_t i : tile) view.add_cone(rays_.dx[i], rays_.dy[i], rays_.dz[i], spread);
    if (raycaster_.bodies().any_in(view))
      selected_.insert(selected_.end(), tile.begin(), tile.end());
  }
  if (loses_rays(part)) leave_out_lost(part, selected_);
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
      if (rays_.number[k] != number) continue;  // the ray gives no point
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

/// Returns the rays without sub-rays that may meet leaves. They include rays that are not cast.
std::span<const std::uint32_t> Caster::order_for_leaves(const Part& part) {
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

/// Merges the echoes of each beam's sub-rays.
void Caster::merge_beams(const Part& part) {
  const ScannerUnit& scanner = part.scanner;
  const bool several = scanner.returns.echo_mode() != EchoMode::kStrongest;
  others_.clear();
  sunlit_ = echoes_.reflectance;
  EchoMerger(scanner.returns.separation_m(), scanner.returns.path())
      .merge(sub_, sub_echoes_, weaker_, beams_, rays_.ring, echoes_, sunlit_,
             several ? &others_ : nullptr);
}

/// Appends the other echoes of the rays to `echoes_`, and sets the columns of each echo's ray.
void Caster::add_other_echoes() {
  std::ranges::stable_sort(others_, {}, &WeakerEcho::ray);
  const std::size_t n = rays_.size();
  number_ = rays_.number;
  ring_ = rays_.ring;
  rank_.assign(n, 0);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < others_.size(); ++i) {
    const bool same = kept > 0 && others_[kept - 1].ray == others_[i].ray;
    const auto rank = static_cast<std::uint8_t>(same ? rank_.back() + 1 : 1);
    if (rank >= kMostEchoes) continue;
    others_[kept++] = others_[i];
    rank_.push_back(rank);
    number_.push_back(rays_.number[others_[i].ray]);
    ring_.push_back(rays_.ring[others_[i].ray]);
    sunlit_.push_back(sunlit_[others_[i].ray]);
  }
  others_.resize(kept);
  echoes_.resize(n + kept);
  for (std::size_t i = 0; i < kept; ++i) echoes_.set(n + i, others_[i].echo);
}

/// Keeps the returns that the echo mode selects, by increasing number of the ray.
void Caster::choose_echoes(EchoMode mode) {
  if (others_.empty()) return;
  const auto first_other =
      std::ranges::lower_bound(returns_.echo, static_cast<std::uint32_t>(rays_.size()));
  auto other = first_other - returns_.echo.begin();
  const ReturnBatch all = returns_;
  std::vector<std::size_t> kept, rows;  // positions in `all`
  const auto range = [&](std::size_t row) { return echoes_.range[all.echo[row]]; };
  const auto choose = [&] {
    if (rows.size() < 2) return kept.insert(kept.end(), rows.begin(), rows.end()), void();
    // The rows are in the order of strength.
    const std::size_t nearest = *std::ranges::min_element(rows, {}, range);
    const std::size_t farthest = *std::ranges::max_element(rows, {}, range);
    if (mode == EchoMode::kFirst) return kept.push_back(nearest);
    if (mode == EchoMode::kLast) return kept.push_back(farthest);
    kept.push_back(rows[0]);
    kept.push_back(farthest == rows[0] ? rows[1] : farthest);
  };
  const auto mains = static_cast<std::size_t>(other);
  std::size_t main = 0, more = mains;
  while (main < mains || more < all.size()) {
    const std::uint32_t a = main < mains ? all.echo[main] : ~0U;
    const std::uint32_t b = more < all.size() ? ray_of(all.echo[more]) : ~0U;
    rows.clear();
    if (a <= b) rows.push_back(main++);
    for (const std::uint32_t ray = std::min(a, b);
         more < all.size() && ray_of(all.echo[more]) == ray;)
      rows.push_back(more++);
    choose();
  }
  returns_.resize(kept.size());
  for (std::size_t n = 0; n < kept.size(); ++n) {
    returns_.echo[n] = all.echo[kept[n]];
    returns_.range[n] = all.range[kept[n]];
    returns_.intensity[n] = all.intensity[kept[n]];
  }
}

void Caster::detect(const Part& part, FrameBuilder& out) {
  const bool wide = part.scanner.beam.has_value();
  const EchoMode mode = part.scanner.returns.echo_mode();
  if (mode == EchoMode::kStrongest) others_.clear();
  const bool several = mode != EchoMode::kStrongest && !others_.empty();
  if (several) add_other_echoes();
  StageTimes::measure(times_, Stage::kReturns, [&] {
    part.scanner.returns.apply(
        part.frame, part.first_ray, echoes_, wide ? sunlit_ : echoes_.reflectance,
        several ? ring_ : rays_.ring, returns_, several ? number_ : rays_.number,
        several ? std::span<const std::uint8_t>(rank_) : std::span<const std::uint8_t>{});
    choose_echoes(mode);
  });
  StageTimes::measure(times_, Stage::kMaking, [&] { make_returned_rays(part); });
  StageTimes::measure(times_, Stage::kCollecting,
                      [&] { collect(part.vehicles.moving, wide, out); });
}

void Caster::collect(std::span<const MovingObject> objects, bool wide, FrameBuilder& out) const {
  out.reserve(returns_.size());
  std::uint32_t before = ~0U;  // ray of the previous return
  for (std::size_t n = 0; n < returns_.size(); ++n) {
    const std::uint32_t echo = returns_.echo[n], i = ray_of(echo);
    const std::int32_t object = echoes_.object[echo];
    if (bodies_only_ && object < 0) continue;
    const MovingObject* hit = object < 0 ? nullptr : &objects[static_cast<std::size_t>(object)];
    out.add({.dx = rays_.dx[i],
             .dy = rays_.dy[i],
             .dz = rays_.dz[i],
             .range = returns_.range[n],
             .hit_range = echoes_.range[echo],
             .wide = wide,
             .second = i == before,
             .intensity = returns_.intensity[n],
             .time = rays_.time[i],
             .ring = rays_.ring[i],
             .class_id = hit != nullptr ? static_cast<std::uint16_t>(hit->object_class)
                                        : echoes_.class_id[echo],
             .object = object},
            hit != nullptr ? hit->id : -1);
    before = i;
  }
}

}  // namespace infrasim
