#include "infrasim/pipeline/simulate.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <string>

#include "infrasim/core/math.h"
#include "infrasim/pipeline/caster.h"
#include "infrasim/pipeline/frame_builder.h"
#include "infrasim/pipeline/scan_time.h"
#include "infrasim/pipeline/scene_filters.h"
#include "infrasim/pipeline/static_units.h"
#include "infrasim/pipeline/vehicles.h"

namespace infrasim {

namespace {

/// One LiDAR, with all data that its rays require.
struct Lidar {
  std::vector<ScannerUnit> scanners;
  double reach = 0;
  /// minimum pause in an object's returns that counts as a split at the cut angle
  double cut_s = kInf;
  FrameBuilder builder;
  std::size_t rays_cast = 0;  ///< number of rays cast in the current frame

  void start() {
    builder.start();
    rays_cast = 0;
  }
};

using UnitLayers = std::vector<std::shared_ptr<const StaticLayer>>;

UnitLayers layers_of(const StaticLayers& layers, std::size_t lidar) {
  return layers.empty() ? UnitLayers{} : layers[lidar];
}

/// @param layers static layers of the units; if empty, all rays are cast
/// @param stream_prefix  prefix of the names of random streams, except that of the start angles of
///   motors
Lidar make_lidar(const SceneConfig& scene, const LidarConfig& config, const UnitLayers& layers,
                 const std::string& stream_prefix = "") {
  Lidar lidar;
  lidar.cut_s = cut_s(config);
  lidar.scanners = make_scanner_units(scene, config, stream_prefix);
  for (std::size_t i = 0; i < layers.size(); ++i) lidar.scanners[i].layer = layers[i];
  for (const LidarUnit& unit : config.units)
    lidar.reach = std::max(lidar.reach, unit.returns.max_range_m);
  return lidar;
}

/// Returns the time (s) that a function takes.
template <class Work>
double timed(const Work& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

struct FrameSimulator::Impl {
  const World& world;
  double frame_s;  ///< frame period of the LiDARs
  std::vector<WorldSlice> slices;
  std::vector<Lidar> lidars;
  LidarFilters filters;  ///< filters of each LiDAR
  double reach = 0;
  bool pitched;  ///< whether an object of the run may have a pitch angle
  Raycaster raycaster;
  Caster caster;
  FrameVehicles vehicles;

  Impl(const World& w, std::span<const LidarConfig> configs, const StaticLayers& layers,
       LidarFilters made)
      : world(w),
        frame_s(period_s(configs)),
        slices(world_slices(w.scene.aggregation)),
        filters(std::move(made)),
        pitched(w.trajectories->pitched),
        raycaster(w.raycaster()),
        caster(raycaster, w.scene.vehicle_parts, w.leaves) {
    for (std::size_t i = 0; i < configs.size(); ++i) {
      lidars.push_back(make_lidar(world.scene, configs[i], layers_of(layers, i)));
      reach = std::max(reach, lidars.back().reach);
    }
  }

  /// Returns the points of one frame without moving objects.
  std::vector<float> empty_frame(int k, Lidar& lidar) {
    vehicles = {};
    raycaster.set_bodies({}, frame_s);
    lidar.start();
    cast_slice(k, WorldSlice{}, lidar);
    return {lidar.builder.xyz().begin(), lidar.builder.xyz().end()};
  }

  void cast_slice(int k, const WorldSlice& slice, Lidar& lidar) {
    lidar.builder.see_objects_at(slice.frozen ? std::optional(slice.middle() * frame_s)
                                              : std::nullopt);
    for (ScannerUnit& scanner : lidar.scanners)
      lidar.rays_cast += caster.cast(k, slice, vehicles, scanner, lidar.builder);
  }

  Box3d box_at(std::size_t vehicle, double time_s) const {
    return world.level.to_level(
        vehicles.moving[vehicle].at(std::clamp(time_s / frame_s, 0.0, 1.0)));
  }

  /// Returns the times at which the objects were scanned, since the start of the frame. For objects
  /// without a hit, the time is mid-frame.
  std::vector<double> scan_times_s(const Lidar& lidar) const {
    std::vector<double> out;
    for (std::vector<double>& times : lidar.builder.times_seen(vehicles.size()))
      out.push_back(times.empty() ? frame_s / 2 : scan_time_s(times, lidar.cut_s));
    return out;
  }

  std::vector<Observation> observations(const Lidar& lidar) const {
    const std::vector<PointSpread> points = lidar.builder.spread(
        vehicles.size(), [&](std::size_t i, double time_s) { return box_at(i, time_s); });
    std::vector<Observation> out;
    for (std::size_t i = 0; i < vehicles.size(); ++i) {
      if (points[i].points == 0 || vehicles.visibility[i] < 0) continue;
      const Box3d& box = vehicles.boxes[i];
      out.push_back({.id = vehicles.moving[i].id,
                     .points = points[i],
                     .distance = math::hypot(box.x, box.y),
                     .visibility = vehicles.visibility[i]});
    }
    return out;
  }

  Frame finish(Lidar& lidar, std::span<const FilterStep> steps) const {
    Frame frame;
    frame.rays_cast = lidar.rays_cast;
    frame.pitched = pitched;
    const std::vector<double> times = scan_times_s(lidar);
    std::vector<ObjectBoxes> boxes;
    for (std::size_t i = 0; i < vehicles.size(); ++i)
      boxes.push_back({vehicles.boxes[i], box_at(i, times[i])});
    if (!steps.empty())
      lidar.builder.keep(keep_all(steps, lidar.builder.xyz(),
                                  [&](const FilterStep& step, std::size_t n, std::size_t after) {
                                    frame.no_plane |= has_no_plane(step, n, after);
                                  }));
    frame.cloud = lidar.builder.cloud();
    const std::vector<PointCount> counts =
        lidar.builder.count(boxes, [&](std::size_t i, double time_s) { return box_at(i, time_s); });
    for (std::size_t i = 0; i < vehicles.size(); ++i) {
      const Box3d& box = vehicles.boxes[i];
      const double distance = math::hypot(box.x, box.y);
      if (distance > lidar.reach && counts[i].points == 0) continue;
      const MovingObject& o = vehicles.moving[i];
      frame.objects.push_back({o.id, o.object_class, box, o.speed_m_s, counts[i].points,
                               counts[i].points_in_box, distance, vehicles.visibility[i],
                               boxes[i].scan, times[i], counts[i].points_in_scan_box});
    }
    return frame;
  }
};

namespace {

/// Returns whether a period of the pattern is at most as long as the simulated time. If the period
/// is longer, a static layer costs more time than it saves.
bool pays(const ScanPattern& pattern, double seconds) {
  const double groups = seconds * pattern.groups_per_s();
  return static_cast<double>(pattern.repeats_after()) <= std::round(groups);
}

}  // namespace

StaticLayers make_static_layers(const World& world, std::span<const LidarConfig> lidars,
                                std::size_t frames, std::size_t most_bytes) {
  Raycaster raycaster = world.raycaster();
  StaticLayers layers;
  std::size_t bytes_left = most_bytes;
  for (const LidarConfig& config : lidars) {
    UnitLayers& units = layers.emplace_back();
    const std::vector<ScannerUnit> scanners = make_scanner_units(world.scene, config);
    const auto file = world.static_layers.find(config.name);
    const bool read = file != world.static_layers.end();
    if (read) {
      check_is_of(file->second, units_without_hits(config, scanners), words_of(config));
      check_is_from(file->second, layer_origin(world.scene, world.background()));
    }
    for (std::size_t i = 0; i < scanners.size(); ++i) {
      const ScannerUnit& scanner = scanners[i];
      const ScanPattern& pattern = scanner.pattern;
      if (read) {
        units.push_back(std::make_shared<const StaticLayer>(
            pattern, file->second.units[i], scanner.returns, world.leaves, scanner.half_width()));
      } else if (scanner.can_have_layer() && layer_bytes(pattern) <= bytes_left &&
                 pays(pattern, static_cast<double>(frames) * period_s(config))) {
        units.push_back(std::make_shared<const StaticLayer>(
            pattern, cast_static(pattern, scanner.max_range, raycaster), scanner.returns,
            world.leaves, scanner.half_width()));
        bytes_left -= layer_bytes(pattern);
      } else {
        units.push_back(nullptr);
      }
    }
  }
  return layers;
}

LidarFilters FrameSimulator::learn_filters(const World& world, std::span<const LidarConfig> lidars,
                                           const StaticLayers& layers) {
  LidarFilters out;
  std::optional<Impl> impl;
  for (std::size_t i = 0; i < lidars.size(); ++i) {
    // The background is learnt from frames whose noise differs from that of the filtered frames.
    std::optional<Lidar> learning;
    out.push_back(std::make_shared<const std::vector<FilterStep>>(
        make_filters(*world.site, world.scene.mounts.begin()->second, [&](int k) {
          if (!impl) impl.emplace(world, std::span<const LidarConfig>{}, StaticLayers{}, out);
          impl->frame_s = period_s(lidars);
          if (!learning)
            learning = make_lidar(world.scene, lidars[i], layers_of(layers, i), "background ");
          return impl->empty_frame(k, *learning);
        })));
  }
  return out;
}

FrameSimulator::FrameSimulator(const World& world, std::span<const LidarConfig> lidars,
                               const StaticLayers& layers, const LidarFilters& filters)
    : impl_(std::make_unique<Impl>(world, lidars, layers, filters)) {}
FrameSimulator::~FrameSimulator() = default;
FrameSimulator::FrameSimulator(FrameSimulator&&) noexcept = default;

const LidarFilters& FrameSimulator::filters() const { return impl_->filters; }

void FrameSimulator::measure(StageTimes& times) { impl_->caster.measure(times); }

std::vector<std::vector<Observation>> FrameSimulator::observe(int k) {
  Impl& m = *impl_;
  check_frame(m.world.frames(m.frame_s), k);
  m.caster.see_bodies_only();
  m.vehicles = set_vehicles(m.world, k, m.frame_s, m.reach, m.raycaster);
  for (Lidar& lidar : m.lidars) lidar.start();
  for (const WorldSlice& slice : m.slices) {
    if (slice.frozen) freeze_vehicles(m.world, m.vehicles, m.frame_s, slice.middle(), m.raycaster);
    for (Lidar& lidar : m.lidars) m.cast_slice(k, slice, lidar);
  }
  std::vector<std::vector<Observation>> out;
  for (const Lidar& lidar : m.lidars) out.push_back(m.observations(lidar));
  return out;
}

std::vector<Frame> FrameSimulator::simulate(int k, const std::vector<bool>& wanted) {
  Impl& m = *impl_;
  check_frame(m.world.frames(m.frame_s), k);
  std::vector<std::size_t> asked;
  for (std::size_t i = 0; i < wanted.size(); ++i)
    if (wanted[i]) asked.push_back(i);

  double shared = 0;
  const auto place = [&](const auto& work) {
    if (!asked.empty()) shared += timed(work);
  };
  place([&] { m.vehicles = set_vehicles(m.world, k, m.frame_s, m.reach, m.raycaster); });
  std::vector<double> seconds(m.lidars.size());
  for (const std::size_t i : asked) m.lidars[i].start();
  for (const WorldSlice& slice : m.slices) {
    if (slice.frozen)
      place([&] { freeze_vehicles(m.world, m.vehicles, m.frame_s, slice.middle(), m.raycaster); });
    for (const std::size_t i : asked)
      seconds[i] += timed([&] { m.cast_slice(k, slice, m.lidars[i]); });
  }
  std::vector<Frame> frames(m.lidars.size());
  for (const std::size_t i : asked) {
    seconds[i] += timed([&] { frames[i] = m.finish(m.lidars[i], *m.filters[i]); });
    seconds[i] += shared / static_cast<double>(asked.size());
  }
  for (std::size_t i = 0; i < frames.size(); ++i) {
    frames[i].seconds = seconds[i];
    for (const ScannerUnit& scanner : m.lidars[i].scanners)
      frames[i].rays += static_cast<std::size_t>(scanner.rays(k).size());
  }
  return frames;
}

}  // namespace infrasim
