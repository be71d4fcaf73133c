#include "infrasim/pipeline/simulate.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>

#include "infrasim/pipeline/frame_builder.h"
#include "infrasim/pipeline/scene_filters.h"
#include "infrasim/sensor/beam.h"
#include "infrasim/sensor/pattern_table.h"
#include "infrasim/sensor/reflectance.h"
#include "infrasim/sensor/return_model.h"
#include "infrasim/sensor/scan_pattern.h"

namespace infrasim {

namespace {

constexpr int kChunkRays = 4096;  // rays worked on at once: they stay in the first-level cache

/// One optical unit, ready to fire.
struct Unit {
  ScanPattern pattern;
  ReturnModel returns;
  std::optional<Beam> beam;
  float max_range;
  std::string stream;                                              ///< name of its random numbers
  std::map<std::int64_t, std::vector<std::uint32_t>> tile_orders;  ///< by number of groups

  std::span<const std::uint32_t> order(std::int64_t groups) {
    auto& order = tile_orders[groups];
    if (order.empty()) order = pattern.tile_order(static_cast<int>(groups));
    return order;
  }
};

struct Lidar {
  std::vector<Unit> units;
  double reach = 0;
  FrameBuilder builder;
  std::vector<FilterStep> filters;
};

Lidar make_lidar(const SceneConfig& scene, const LidarConfig& config) {
  const MountConfig& mount = scene.mounts.begin()->second;
  Lidar lidar;
  int first_ring = 0;
  for (std::size_t i = 0; i < config.units.size(); ++i) {
    const LidarUnit& unit = config.units[i];
    const Mat3 pose = rotation(0, rad(mount.pitch_deg), rad(mount.roll_deg)) *
                      rotation(rad(unit.yaw_deg), rad(unit.pitch_deg), 0);
    const double phase = start_phase_s(scene.seed, config, i);
    lidar.units.push_back(
        {ScanPattern(unit.pattern, phase, pose, first_ring),
         ReturnModel(unit.returns, scene.weather),
         unit.returns.beam ? std::optional<Beam>(Beam(*unit.returns.beam, pose)) : std::nullopt,
         static_cast<float>(unit.returns.max_range_m),
         stream_name(config, i),
         {}});
    first_ring += lidar.units.back().pattern.group_size();
    lidar.reach = std::max(lidar.reach, unit.returns.max_range_m);
  }
  return lidar;
}

/// The vehicles of one frame, levelled frame, with what does not depend on the LiDAR.
struct Objects {
  std::vector<MovingObject> moving;
  std::vector<MovingBody> placed;
  std::vector<Box3d> boxes;  ///< at mid-frame
  std::vector<float> reflectance;
  std::vector<double> visibility;
};

/// True if some part of the object can be within reach at some time of the frame.
bool reachable(const MovingObject& o, const Box3d& middle, double reach) {
  const double travel = std::hypot(o.to.x - o.from.x, o.to.y - o.from.y);
  const double half_diagonal = std::hypot(middle.dx, middle.dy) / 2;
  return std::hypot(middle.x, middle.y) <= reach + half_diagonal + travel / 2 + 0.1;
}

}  // namespace

struct FrameSimulator::Impl {
  const World& world;
  std::vector<WorldSlice> slices;
  std::vector<Lidar> lidars;
  double reach = 0;
  Raycaster raycaster;
  Objects objects;
  RayBatch rays;
  std::vector<std::uint32_t> selected;
  HitBatch hits;
  ReturnBatch returns;
  std::vector<float> reflectance;
  RayBatch sub_rays;  ///< of beams wider than a ray
  HitBatch sub_hits;
  std::vector<std::uint32_t> sub_selected;
  std::vector<float> sub_reflectance;

  Impl(const World& w, std::span<const LidarConfig> configs)
      : world(w), slices(world_slices(w.scene.aggregation)), raycaster(*w.meshes) {
    for (const LidarConfig& config : configs) {
      lidars.push_back(make_lidar(world.scene, config));
      reach = std::max(reach, lidars.back().reach);
    }
    for (Lidar& lidar : lidars)
      lidar.filters =
          make_filters(world.scene.filters, [&](int k) { return empty_frame(lidar, k); });
  }

  /// Points of one frame without any vehicle.
  std::vector<float> empty_frame(Lidar& lidar, int k) {
    objects = {};
    raycaster.set_bodies({}, kFramePeriod);
    lidar.builder.start();
    cast_slice(k, WorldSlice{}, lidar);
    return {lidar.builder.xyz().begin(), lidar.builder.xyz().end()};
  }

  void place_objects(int k) {
    objects = {};
    for (const MovingObject& o : world.trajectories.in_frame(k)) {
      const Box3d box = world.level.to_level(o.at(0.5));
      if (!reachable(o, box, reach)) continue;
      objects.moving.push_back(o);
      objects.placed.push_back({static_cast<int>(body_index(o.object_class)),
                                world.level.to_level(o.from), world.level.to_level(o.to)});
      objects.boxes.push_back(box);
      objects.reflectance.push_back(paint_reflectance(
          Rng::of(world.scene.seed, "paint").at(static_cast<std::uint64_t>(o.id) + 1)));
    }
    raycaster.set_bodies(objects.placed, kFramePeriod);
    for (std::size_t i = 0; i < objects.moving.size(); ++i) {
      const Box3d middle = objects.moving[i].at(0.5);
      const bool seen = world.region.contains({middle.x, middle.y});
      objects.visibility.push_back(seen ? raycaster.visibility(i) : -1);
    }
  }

  void freeze_objects(double u) {
    std::vector<MovingBody> frozen = objects.placed;
    for (std::size_t i = 0; i < frozen.size(); ++i)
      frozen[i].from = frozen[i].to = world.level.to_level(objects.moving[i].at(u));
    raycaster.set_bodies(frozen, kFramePeriod);
  }

  void cast_slice(int k, const WorldSlice& slice, Lidar& lidar) {
    for (Unit& unit : lidar.units) {
      const RayRange frame = unit.pattern.fired_between(k * kFramePeriod, (k + 1) * kFramePeriod);
      const RayRange range = unit.pattern.fired_between((k + slice.from) * kFramePeriod,
                                                        (k + slice.to) * kFramePeriod);
      const Rng rng = Rng::of(world.scene.seed, unit.stream).at(static_cast<std::uint64_t>(k) + 1);
      const int group = unit.pattern.group_size();
      const std::int64_t chunk = group * std::max(4, kChunkRays / group / 4 * 4);
      for (std::int64_t first = range.first; first < range.last; first += chunk) {
        const RayRange part{first, std::min(first + chunk, range.last)};
        unit.pattern.generate(part, k * kFramePeriod, rays);
        rays.max_range = unit.max_range;
        const auto first_in_frame = static_cast<std::uint64_t>(part.first - frame.first);
        select(unit, rng, first_in_frame, part.size() / group);
        cast(unit);
        unit.returns.apply(rng, first_in_frame, hits, reflectance, returns);
        collect(lidar.builder);
      }
    }
  }

  /// Names the rays worth casting, near ones together: not those that look over everything there
  /// is, nor those whose return is lost whatever they hit.
  void select(Unit& unit, const Rng& rng, std::uint64_t first, std::int64_t groups) {
    const float highest_dz = raycaster.top() < 0 && !unit.beam ? 0 : 1;
    selected.clear();
    for (const std::uint32_t i : unit.order(groups)) {
      if (rays.dz[i] > highest_dz) continue;
      if (unit.returns.loses_at_random() && unit.returns.lost_at_random(rng, first + i)) continue;
      selected.push_back(i);
    }
  }

  void cast(const Unit& unit) {
    if (unit.beam) return cast_beams(*unit.beam);
    raycaster.cast(rays, selected, hits, unit.returns.needs_reflectance());
    if (unit.returns.needs_reflectance()) look_up_reflectance(hits, reflectance);
  }

  void cast_beams(const Beam& beam) {
    beam.expand(rays, sub_rays);
    const auto n = static_cast<std::uint32_t>(beam.sub_rays());
    sub_selected.clear();
    for (const std::uint32_t i : selected)
      for (std::uint32_t j = 0; j < n; ++j) sub_selected.push_back(n * i + j);
    raycaster.cast(sub_rays, sub_selected, sub_hits, true);
    look_up_reflectance(sub_hits, sub_reflectance);
    beam.combine(sub_hits, sub_reflectance, hits, reflectance);
  }

  void look_up_reflectance(const HitBatch& batch, std::vector<float>& out) const {
    out.resize(batch.size());
    for (std::size_t i = 0; i < batch.size(); ++i)
      out[i] = batch.object[i] >= 0 ? objects.reflectance[static_cast<std::size_t>(batch.object[i])]
                                    : background_reflectance(static_cast<Class>(batch.class_id[i]));
  }

  void collect(FrameBuilder& builder) const {
    builder.reserve(returns.size());
    for (std::size_t n = 0; n < returns.size(); ++n) {
      const std::uint32_t i = returns.ray[n];
      const std::int32_t object = hits.object[i];
      const MovingObject* hit =
          object < 0 ? nullptr : &objects.moving[static_cast<std::size_t>(object)];
      builder.add(
          {rays.dx[i], rays.dy[i], rays.dz[i], returns.range[n], returns.intensity[n], rays.time[i],
           rays.ring[i],
           hit != nullptr ? static_cast<std::uint16_t>(hit->object_class) : hits.class_id[i],
           object},
          hit != nullptr ? hit->id : -1);
    }
  }

  std::size_t rays_in_frame(int k, const Lidar& lidar) const {
    std::int64_t n = 0;
    for (const Unit& unit : lidar.units)
      n += unit.pattern.fired_between(k * kFramePeriod, (k + 1) * kFramePeriod).size();
    return static_cast<std::size_t>(n);
  }

  Frame finish(Lidar& lidar) const {
    Frame frame;
    std::vector<PointCount> counts;
    if (!lidar.filters.empty()) lidar.builder.keep(keep_all(lidar.filters, lidar.builder.xyz()));
    frame.cloud = lidar.builder.take(objects.boxes, counts);
    for (std::size_t i = 0; i < objects.moving.size(); ++i) {
      const Box3d& box = objects.boxes[i];
      if (std::hypot(box.x, box.y) > lidar.reach && counts[i].points == 0) continue;
      const MovingObject& o = objects.moving[i];
      frame.objects.push_back({o.id, o.object_class, box, o.speed_m_s, counts[i].points,
                               counts[i].points_in_box, std::hypot(box.x, box.y),
                               objects.visibility[i]});
    }
    return frame;
  }
};

FrameSimulator::FrameSimulator(const World& world, std::span<const LidarConfig> lidars)
    : impl_(std::make_unique<Impl>(world, lidars)) {}
FrameSimulator::~FrameSimulator() = default;
FrameSimulator::FrameSimulator(FrameSimulator&&) noexcept = default;

std::vector<Frame> FrameSimulator::simulate(int k, const std::vector<bool>& wanted) {
  Impl& m = *impl_;
  check_frame(m.world, k);
  std::vector<Frame> frames(m.lidars.size());
  std::vector<double> seconds(m.lidars.size());
  const auto timed = [&](std::size_t i, const auto& work) {
    const auto start = std::chrono::steady_clock::now();
    work();
    seconds[i] += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
  if (std::ranges::find(wanted, true) != wanted.end()) m.place_objects(k);
  for (Lidar& lidar : m.lidars) lidar.builder.start();
  for (const WorldSlice& slice : m.slices) {
    if (slice.frozen) m.freeze_objects(slice.middle());
    for (std::size_t i = 0; i < m.lidars.size(); ++i)
      if (wanted[i]) timed(i, [&] { m.cast_slice(k, slice, m.lidars[i]); });
  }
  for (std::size_t i = 0; i < m.lidars.size(); ++i) {
    if (wanted[i]) timed(i, [&] { frames[i] = m.finish(m.lidars[i]); });
    frames[i].rays = m.rays_in_frame(k, m.lidars[i]);
    frames[i].seconds = seconds[i];
  }
  return frames;
}

std::vector<std::string> warnings(const SceneConfig& scene, std::span<const LidarConfig> lidars) {
  std::vector<std::string> lines;
  const WeatherConfig& weather = scene.weather;
  if (weather.rain_mm_per_h == 0 && std::isinf(weather.visibility_m)) return lines;
  for (const LidarConfig& lidar : lidars) {
    const auto blind = std::ranges::count_if(
        lidar.units, [](const LidarUnit& unit) { return !unit.returns.detection; });
    if (blind == 0) continue;
    const auto units = std::ssize(lidar.units);
    const std::string where = blind == units ? ""
                                             : " on " + std::to_string(blind) + " of its " +
                                                   std::to_string(units) + " units";
    lines.push_back(lidar.name + ", preset " + lidar.preset + ": weather: no effect" + where +
                    ", found no returns.detection, allowed a preset that has it");
  }
  return lines;
}

}  // namespace infrasim
