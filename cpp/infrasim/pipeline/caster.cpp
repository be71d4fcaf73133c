#include "infrasim/pipeline/caster.h"

#include <algorithm>
#include <numeric>

#include "infrasim/sensor/pattern_table.h"

namespace infrasim {

namespace {

constexpr VehicleParts kNoParts{false, false, false, false, false};

constexpr std::uint64_t kLeafDraws = 16;  // of a ray: beyond the numbers of its own draws

/// The first group after a part of the frame that is worked on at once.
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
  return pattern.fired_between((k + from) * kFramePeriod, (k + to) * kFramePeriod);
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
                              int first_ring, const std::string& draws) {
  const LidarUnit& config = lidar.units[unit];
  const Mat3 pose = unit_pose(scene, config);
  const auto& [name, mount] = *scene.mounts.begin();
  const std::string mount_prefix = mount.own_draws.value_or(false) ? "mount " + name + " " : "";
  const auto& beam = config.returns.beam;
  return {
      ScanPattern(config.pattern, start_phase_s(scene.seed, name, lidar, unit), pose, first_ring),
      ReturnModel(config.returns, scene.weather),
      beam ? std::optional<Beam>(Beam(*beam, pose)) : std::nullopt,
      static_cast<float>(config.returns.max_range_m),
      Rng::of(scene.seed, draws + mount_prefix + stream_name(lidar, unit)),
      {},
      {}};
}

}  // namespace

std::vector<ScannerUnit> make_scanner_units(const SceneConfig& scene, const LidarConfig& lidar,
                                            const std::string& draws) {
  std::vector<ScannerUnit> scanners;
  int first_ring = 0;
  for (std::size_t i = 0; i < lidar.units.size(); ++i) {
    scanners.push_back(make_scanner_unit(scene, lidar, i, first_ring, draws));
    first_ring += scanners.back().pattern.group_size();
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
    const RayRange part{first * size, end * size};
    scanner.pattern.generate(part, k * kFramePeriod, rays_);
    rays_.max_range = scanner.max_range;
    const auto first_ray = static_cast<std::uint64_t>(part.first - frame.first);
    cast += cast_part(part, {rng, first_ray}, scanner, vehicles);
    scanner.returns.apply(rng, first_ray, hits_, reflectance_,
                          scanner.beam ? sunlit_ : reflectance_, returns_);
    collect(vehicles.moving, scanner.beam.has_value(), out);
  }
  return cast;
}

Rng Caster::LeafDraws::of(std::uint32_t ray, std::size_t sub_ray) const {
  return frame.at(first_ray + ray).at(kLeafDraws + sub_ray);
}

std::size_t Caster::cast_part(RayRange part, const LeafDraws& draws, ScannerUnit& scanner,
                              const FrameVehicles& vehicles) {
  const int size = scanner.pattern.group_size();
  const std::int64_t first = part.first / size, last = part.last / size;
  const bool reflectance = scanner.returns.needs_reflectance();
  if (scanner.beam) {
    select(scanner, last - first);
    return cast_beams(scanner, draws, vehicles);
  }
  if (scanner.layer) {
    cast_moving(*scanner.layer, first, last, reflectance);
  } else {
    cast_all(scanner, last - first, reflectance);
  }
  const std::size_t cast = selected_.size();
  if (!reflectance) return cast;
  if (!leaves_.empty()) stop_in_leaves(scanner, first, last, draws);
  const StaticSlice background = scanner.layer ? scanner.layer->slice(first, last) : StaticSlice{};
  return cast + transparent_.resolve(rays_, vehicles, parts_, scanner.returns.path(), hits_,
                                     reflectance_, background);
}

/// Names the rays worth casting, near ones together: not those that look over everything there is.
void Caster::select(ScannerUnit& scanner, std::int64_t groups) {
  const float spread = scanner.beam ? scanner.beam->half_width() : 0;
  const bool leaves = scanner.beam && scanner.returns.needs_reflectance() && !leaves_.empty();
  const auto below = [&](const Horizon& horizon, std::uint32_t i) {
    return horizon.covers(rays_.dx[i], rays_.dy[i], rays_.dz[i], spread);
  };
  selected_.clear();
  for (const std::uint32_t i : tile_order(scanner, groups))
    if (below(raycaster_.horizon(), i) || (leaves && below(leaves_.horizon(), i)))
      selected_.push_back(i);
}

/// Also rays that are not cast may meet leaves.
void Caster::stop_in_leaves(ScannerUnit& scanner, std::int64_t first, std::int64_t last,
                            const LeafDraws& draws) {
  std::span<const std::uint32_t> order;
  if (scanner.layer) {
    scanner.layer->select(first, last, leaves_.index(), in_leaves_);
    order = in_leaves_;
  } else {
    order = tile_order(scanner, last - first);
  }
  leaves_.stop(rays_, order, [&](std::uint32_t k) { return draws.of(k, 0); }, hits_);
}

void Caster::cast_all(ScannerUnit& scanner, std::int64_t groups, bool incidence) {
  select(scanner, groups);
  raycaster_.cast(rays_, selected_, hits_, incidence);
}

void Caster::cast_moving(const StaticLayer& layer, std::int64_t first, std::int64_t last,
                         bool incidence) {
  layer.hits(first, last, incidence, hits_);
  layer.select(first, last, raycaster_.bodies(), selected_);
  raycaster_.cast_bodies(rays_, selected_, hits_, incidence);
}

std::size_t Caster::cast_beams(const ScannerUnit& scanner, const LeafDraws& draws,
                               const FrameVehicles& vehicles) {
  const Beam& beam = *scanner.beam;
  const EchoPath path = scanner.returns.path();
  const bool reflectance = scanner.returns.needs_reflectance();
  beam.expand(rays_, selected_, sub_rays_);
  sub_selected_.resize(sub_rays_.size());
  std::iota(sub_selected_.begin(), sub_selected_.end(), 0U);
  raycaster_.cast(sub_rays_, sub_selected_, sub_hits_, true);
  const auto width = static_cast<std::uint32_t>(beam.sub_rays());
  const auto draws_of = [&](std::uint32_t k) { return draws.of(selected_[k / width], k % width); };
  if (reflectance && !leaves_.empty()) leaves_.stop(sub_rays_, sub_selected_, draws_of, sub_hits_);
  const std::size_t on = transparent_.resolve(sub_rays_, vehicles, reflectance ? parts_ : kNoParts,
                                              path, sub_hits_, sub_reflectance_);
  hits_.resize(rays_.size());
  beam.combine(sub_hits_, sub_reflectance_, selected_, path, hits_, reflectance_, sunlit_);
  return sub_rays_.size() + on;
}

void Caster::collect(std::span<const MovingObject> objects, bool wide, FrameBuilder& out) const {
  out.reserve(returns_.size());
  for (std::size_t n = 0; n < returns_.size(); ++n) {
    const std::uint32_t i = returns_.ray[n];
    const std::int32_t object = hits_.object[i];
    const MovingObject* hit = object < 0 ? nullptr : &objects[static_cast<std::size_t>(object)];
    out.add({rays_.dx[i], rays_.dy[i], rays_.dz[i], returns_.range[n], hits_.range[i], wide,
             returns_.intensity[n], rays_.time[i], rays_.ring[i],
             hit != nullptr ? static_cast<std::uint16_t>(hit->object_class) : hits_.class_id[i],
             object},
            hit != nullptr ? hit->id : -1);
  }
}

}  // namespace infrasim
