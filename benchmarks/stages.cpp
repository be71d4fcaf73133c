#include "stages.h"

#include <algorithm>
#include <ctime>
#include <numeric>
#include <span>

namespace infrasim {

namespace {

constexpr VehicleParts kNoParts{false, false, false, false, false};
constexpr std::uint64_t kLeafStream = 16;  // as in Caster

std::span<const std::uint32_t> tile_order(ScannerUnit& scanner, std::int64_t groups) {
  auto& order = scanner.tile_orders[groups];
  if (order.empty()) order = scanner.pattern.tile_order(static_cast<int>(groups));
  return order;
}

std::int64_t part_end(const ScannerUnit& scanner, std::int64_t first, std::int64_t last) {
  if (scanner.layer) return scanner.layer->part_end(first, last);
  const int size = scanner.pattern.group_size();
  return std::min(last, first + std::max<std::int64_t>(4, kChunkRays / size / 4 * 4));
}

}  // namespace

double thread_cpu_s() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

StagedCaster::StagedCaster(const World& world, const LidarConfig& lidar)
    : world_(world),
      raycaster_(*world.meshes),
      transparent_(raycaster_),
      scanners_(make_scanner_units(world.scene, lidar)) {
  const StaticLayers layers = make_static_layers(world, {&lidar, 1});
  for (std::size_t i = 0; i < scanners_.size(); ++i) {
    scanners_[i].layer = layers[0][i];
    reach_ = std::max(reach_, lidar.units[i].returns.max_range_m);
  }
}

std::size_t StagedCaster::cast(int k) {
  vehicles_ = set_vehicles(world_, k, reach_, raycaster_);
  builder_.start();
  for (ScannerUnit& scanner : scanners_) {
    const RayRange range = scanner.rays(k);
    const int size = scanner.pattern.group_size();
    const std::int64_t last = range.last / size;
    for (std::int64_t first = range.first / size, end = 0; first < last; first = end) {
      end = part_end(scanner, first, last);
      cast_part(scanner, first, end, k);
    }
    rays_done_ += static_cast<std::size_t>(range.size());
  }
  return builder_.size();
}

void StagedCaster::cast_part(ScannerUnit& scanner, std::int64_t first, std::int64_t last, int k) {
  const int size = scanner.pattern.group_size();
  const Rng frame = scanner.stream.at(static_cast<std::uint64_t>(k) + 1);
  const auto first_ray = static_cast<std::uint64_t>(first * size - scanner.rays(k).first);
  const bool by_power = scanner.returns.needs_reflectance(), wide = scanner.beam.has_value();
  timed(Stage::kMaking, [&] {
    scanner.pattern.generate({first * size, last * size}, k * kUsualPeriod_s, rays_);
    rays_.max_range = scanner.max_range;
  });
  timed(Stage::kSelecting, [&] { select(scanner, first, last); });
  timed(Stage::kCasting, [&] { cast_rays(scanner, first, last); });
  if (by_power && !world_.leaves.empty())
    timed(Stage::kLeaves, [&] { stop_in_leaves(scanner, first, last, frame, first_ray); });
  timed(Stage::kPanes, [&] {
    if (!by_power && !wide) return echoes_.take(hits_);
    const StaticSlice background =
        scanner.layer ? scanner.layer->slice(first, last) : StaticSlice{};
    transparent_.resolve(wide ? sub_rays_ : rays_, vehicles_,
                         by_power ? world_.scene.vehicle_parts : kNoParts, scanner.returns.path(),
                         hits_, echoes_, background);
  });
  if (wide)
    timed(Stage::kBeam, [&] {
      beam_echoes_.resize(rays_.size());
      scanner.beam->combine(echoes_, selected_, scanner.returns.path(), beam_echoes_, sunlit_);
    });
  const EchoBatch& echoes = wide ? beam_echoes_ : echoes_;
  timed(Stage::kReturns, [&] {
    scanner.returns.apply(frame, first_ray, echoes, wide ? sunlit_ : echoes.reflectance, returns_);
  });
  timed(Stage::kCollecting, [&] { collect(echoes, wide); });
}

/// Selects the rays that must be cast, and makes the sub-rays of a wide beam.
void StagedCaster::select(ScannerUnit& scanner, std::int64_t first, std::int64_t last) {
  if (scanner.layer) return scanner.layer->select(first, last, raycaster_.bodies(), selected_);
  const float spread = scanner.beam ? scanner.beam->half_width() : 0;
  const bool leaves = scanner.beam && scanner.returns.needs_reflectance() && !world_.leaves.empty();
  const auto below = [&](const Horizon& horizon, std::uint32_t i) {
    return horizon.covers(rays_.dx[i], rays_.dy[i], rays_.dz[i], spread);
  };
  selected_.clear();
  for (const std::uint32_t i : tile_order(scanner, last - first))
    if (below(raycaster_.horizon(), i) || (leaves && below(world_.leaves.horizon(), i)))
      selected_.push_back(i);
  if (!scanner.beam) return;
  scanner.beam->expand(rays_, selected_, sub_rays_);
  sub_selected_.resize(sub_rays_.size());
  std::iota(sub_selected_.begin(), sub_selected_.end(), 0U);
}

void StagedCaster::cast_rays(const ScannerUnit& scanner, std::int64_t first, std::int64_t last) {
  const bool incidence = scanner.beam || scanner.returns.needs_reflectance();
  if (scanner.layer) {
    scanner.layer->hits(first, last, incidence, hits_);
    return raycaster_.cast_bodies(rays_, selected_, hits_, incidence);
  }
  if (scanner.beam) return raycaster_.cast(sub_rays_, sub_selected_, hits_, true);
  raycaster_.cast(rays_, selected_, hits_, incidence);
}

void StagedCaster::stop_in_leaves(ScannerUnit& scanner, std::int64_t first, std::int64_t last,
                                  const Rng& frame, std::uint64_t first_ray) {
  const auto width = scanner.beam ? static_cast<std::uint32_t>(scanner.beam->sub_rays()) : 0;
  const auto rng_of = [&](std::uint32_t i) {
    const std::uint32_t ray = width > 0 ? selected_[i / width] : i;
    return frame.at(first_ray + ray).at(kLeafStream + (width > 0 ? i % width : 0));
  };
  if (width > 0) return world_.leaves.stop(sub_rays_, sub_selected_, rng_of, hits_);
  if (!scanner.layer)
    return world_.leaves.stop(rays_, tile_order(scanner, last - first), rng_of, hits_);
  scanner.layer->select(first, last, world_.leaves.index(), in_leaves_);
  world_.leaves.stop(rays_, in_leaves_, rng_of, hits_);
}

void StagedCaster::collect(const EchoBatch& echoes, bool wide) {
  builder_.reserve(returns_.size());
  for (std::size_t n = 0; n < returns_.size(); ++n) {
    const std::uint32_t i = returns_.ray[n];
    const std::int32_t object = echoes.object[i];
    const MovingObject* hit =
        object < 0 ? nullptr : &vehicles_.moving[static_cast<std::size_t>(object)];
    builder_.add(
        {rays_.dx[i], rays_.dy[i], rays_.dz[i], returns_.range[n], echoes.range[i], wide,
         returns_.intensity[n], rays_.time[i], rays_.ring[i],
         hit != nullptr ? static_cast<std::uint16_t>(hit->object_class) : echoes.class_id[i],
         object},
        hit != nullptr ? hit->id : -1);
  }
}

}  // namespace infrasim
