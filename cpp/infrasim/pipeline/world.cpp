#include "infrasim/pipeline/world.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <ranges>

#include "infrasim/config/lidar_config.h"
#include "infrasim/core/math.h"
#include "infrasim/pipeline/scene_filters.h"
#include "infrasim/scene/mesh_file.h"
#include "infrasim/scene/sensor_rules.h"
#include "infrasim/scene/site_rules.h"
#include "infrasim/scene/state_source.h"
#include "infrasim/scene/traffic_checks.h"
#include "infrasim/scene/vehicle_body.h"

namespace infrasim {

namespace {

constexpr double kChecked_s = 60;  // duration of simulated traffic that is checked

std::map<std::string, StaticLayerFile> read_static_layers(const SceneConfig& scene) {
  std::map<std::string, StaticLayerFile> layers;
  if (!scene.static_layers) return layers;
  for (const auto& [lidar, file] : *scene.static_layers) {
    config::KeyPlace at = scene.static_layers_key;
    if (!at.key.empty()) at.key += "." + lidar;
    const StaticLayerFile layer =
        config::read_named(at, [&] { return read_static_layer(scene.folder / file); });
    check_is_at(layer, scene.mounts.begin()->second);
    layers.emplace(lidar, layer);
  }
  return layers;
}

double clock_offset_s(const SceneConfig& view) {
  return view.mounts.begin()->second.clock_offset_s.value_or(0);
}

/// Passes the moving objects of the first `instants` instants of a source to `sink`, and checks
/// that no object is at the position of a sensor.
void each_checked(const StateSource& source, const SceneConfig& scene, int instants,
                  const StateSink& sink) {
  check_sensor_is_free(scene, source.standing(), 0);
  StateSteps steps(source);
  for (int k = 0; k < instants; ++k) {
    const std::vector<ObjectState> states = steps.next_moving();
    check_sensor_is_free(scene, states, k);
    sink(states);
  }
}

/// Returns whether a box is so far from the sensor that no ray, and no object hit by a ray, extends
/// to it.
bool is_beyond_all_rays(const Box3d& box) {
  constexpr double kObjects_m = 200;  // metres, upper limit of the extent of an object
  return math::hypot(box.x, box.y) - math::hypot(box.dx, box.dy) > kLongestRange_m + kObjects_m;
}

std::vector<std::string> findings_of(const Site& site, const Surface& surface,
                                     const TrafficChecks& checks) {
  std::vector<std::string> lines = checks.warnings();
  std::ranges::move(unit_warnings(site, surface), std::back_inserter(lines));
  return lines;
}

}  // namespace

std::size_t body_index(Class object_class) {
  return static_cast<std::size_t>(
      std::ranges::find(kObjectClasses, object_class, &ObjectClass::id) - kObjectClasses.begin());
}

std::vector<bool> rows_of_frames(std::span<const int> frames, double period_s, int steps) {
  std::vector<bool> rows(static_cast<std::size_t>(steps) + 1);
  for (const int k : frames) {
    const int first = static_cast<int>(std::floor(row_position(k * period_s)));
    const int last = static_cast<int>(std::ceil(row_position((k + 1) * period_s)));
    for (int row = first; row <= std::min(last, steps); ++row)
      rows[static_cast<std::size_t>(row)] = true;
  }
  return rows;
}

void mark_true_rows(const std::vector<bool>& rows, double late_s, std::vector<bool>& true_rows) {
  const int steps = static_cast<int>(rows.size()) - 1;
  for (int k = 0; k <= steps; ++k) {
    if (!rows[static_cast<std::size_t>(k)]) continue;
    const auto [first, last] = rows_around(row_position(k * kRowStep_s + late_s), steps);
    true_rows[static_cast<std::size_t>(first)] = true;
    true_rows[static_cast<std::size_t>(last)] = true;
  }
}

std::shared_ptr<const SceneMeshes> build_meshes(const Site& site) {
  Surface surface = build_static_surface(site);
  const LevelPose level = level_pose(site.scene.mounts.begin()->second);
  std::vector<TriangleMesh> bodies;
  for (const ObjectClass& row : kObjectClasses)
    bodies.push_back(build_vehicle_body(row.id, site.scene.detail));
  MeshLibrary library(to_level(surface, level), bodies);
  return std::make_shared<const SceneMeshes>(
      SceneMeshes{std::move(surface), level, std::move(bodies), std::move(library)});
}

World build_world_at(const SceneConfig& scene, const std::shared_ptr<const Site>& site,
                     const std::shared_ptr<const SceneMeshes>& meshes,
                     std::shared_ptr<const Trajectories> trajectories) {
  const MountConfig& mount = scene.mounts.begin()->second;
  const LevelPose level = level_pose(mount);
  check_sensor_in_meshes(*site, scene.mounts.begin()->first, mount, meshes->surface);
  check_filters(*site, scene.mounts.begin()->first, mount);
  std::vector<LeafVolume> leaves = site->leaves;
  for (LeafVolume& volume : leaves) {
    volume.box.z += site->profile.rise({volume.box.x, volume.box.y});
    volume.box = level.to_level(volume.box);
  }
  std::erase_if(leaves, [](const LeafVolume& volume) { return is_beyond_all_rays(volume.box); });
  return {
      scene,
      site,
      level,
      EvaluationRegion(*site, mount),
      std::move(trajectories),
      meshes,
      meshes->library.origin(meshes->level.to_level(level.origin), level.yaw - meshes->level.yaw),
      Volumes(leaves),
      read_static_layers(scene),
      nullptr,
      clock_offset_s(scene)};
}

std::vector<World> build_worlds(const SceneConfig& scene, const std::vector<std::string>& mounts) {
  std::vector<int> all(static_cast<std::size_t>(row_steps(scene.duration_s)));
  std::iota(all.begin(), all.end(), 0);
  return build_worlds(scene, mounts, all, kRowStep_s);
}

std::vector<World> build_worlds(const SceneConfig& scene, const std::vector<std::string>& mounts,
                                std::span<const int> frames, double period_s) {
  std::vector<SceneConfig> views;
  for (const std::string& mount : mounts) views.push_back(scene_at_mount(scene, mount));
  const auto site = std::make_shared<const Site>(checked_site(scene));
  std::vector<bool> rows = rows_of_frames(frames, period_s, row_steps(scene.duration_s));
  // A run writes all rows of recorded trajectories.
  if (!scene.traffic) rows.assign(rows.size(), true);
  std::vector<bool> asked(rows.size());
  for (const SceneConfig& view : views) mark_true_rows(rows, clock_offset_s(view), asked);
  const auto last = std::find(asked.rbegin(), asked.rend(), true);
  TrafficChecks checks(*site);
  const auto trajectories = [&] {
    const StateSource source(*site);
    TrajectoryKeeper keeper(asked, source.pitched());
    each_checked(source, scene, static_cast<int>(asked.rend() - last), [&](const auto& states) {
      checks.take(with_standing(states, source.standing()));
      keeper.take(states);
    });
    auto kept = std::make_shared<Trajectories>(keeper.finish());
    kept->standing = source.standing();
    return std::shared_ptr<const Trajectories>(std::move(kept));
  }();
  const auto meshes = build_meshes(*site);
  std::vector<World> worlds;
  for (const SceneConfig& view : views)
    worlds.push_back(build_world_at(view, site, meshes, trajectories));
  for (World& world : worlds) world.warnings = findings_of(*site, meshes->surface, checks);
  return worlds;
}

std::vector<MovingObject> World::objects_in_frame(int k, double period_s) const {
  const double from = position(k * period_s), to = position((k + 1) * period_s);
  return lazy_trajectories ? lazy_trajectories->between(from, to) : trajectories->between(from, to);
}

World build_lazy_world(const SceneConfig& scene, const std::string& mount) {
  if (!scene.traffic) return build_world(scene, mount);
  const SceneConfig view = scene_at_mount(scene, mount);
  const auto site = std::make_shared<const Site>(checked_site(scene));
  auto lazy = std::make_shared<LazyTrajectories>(site);
  TrajectoryKeeper none(std::vector<bool>(static_cast<std::size_t>(lazy->steps()) + 1),
                        lazy->pitched());
  World world = build_world_at(view, site, build_meshes(*site),
                               std::make_shared<const Trajectories>(none.finish()));
  world.lazy_trajectories = std::move(lazy);
  return world;
}

World build_static_world(const SceneConfig& scene, const std::string& mount) {
  const auto site = std::make_shared<const Site>(checked_site(scene));
  return build_world_at(scene_at_mount(scene, mount), site, build_meshes(*site),
                        std::make_shared<const Trajectories>());
}

std::vector<std::string> check_worlds(const SceneConfig& scene, bool drive) {
  const auto site = std::make_shared<const Site>(checked_site(scene));
  TrafficChecks checks(*site);
  if (drive) {
    const StateSource source(*site);
    each_checked(source, scene, row_steps(scene.duration_s) + 1, [&](const auto& states) {
      checks.take(with_standing(states, source.standing()));
    });
  }
  const auto meshes = build_meshes(*site);
  for (const std::string& mount : mount_names(scene))
    build_world_at(scene_at_mount(scene, mount), site, meshes,
                   std::make_shared<const Trajectories>());
  return findings_of(*site, meshes->surface, checks);
}

bool move_alike(const SceneConfig& a, const SceneConfig& b) {
  const auto text = [](SceneConfig scene) {
    const SceneConfig none;  // defaults of keys that do not change the motion of vehicles
    scene.aggregation = none.aggregation;
    scene.detail = none.detail;
    scene.vehicle_parts = none.vehicle_parts;
    scene.labels = none.labels;
    scene.label_time = none.label_time;
    scene.point_fields = none.point_fields;
    scene.weather = none.weather;
    scene.meshes = none.meshes;
    scene.ground = none.ground;
    scene.buildings = none.buildings;
    scene.barriers = none.barriers;
    scene.gantries = none.gantries;
    scene.vegetation = none.vegetation;
    scene.filters = none.filters;
    scene.static_layers = none.static_layers;
    return dump_scene(scene);
  };
  return text(a) == text(b);
}

World build_world(const SceneConfig& scene, const std::string& mount) {
  return std::move(build_worlds(scene, {mount}).front());
}

std::vector<std::string> mount_names(const SceneConfig& scene) {
  const auto names = std::views::keys(scene.mounts);
  return {names.begin(), names.end()};
}

std::vector<Overlap> traffic_overlaps(SceneConfig scene) {
  if (scene.traffic) scene.duration_s = kChecked_s;
  const Site site = checked_site(scene);
  OverlapSearch search;
  StateSource(site).each([&](const auto& states) { search.take(states); });
  return search.overlaps();
}

void check_frame(int frames, int k) {
  if (k < 0 || k >= frames)
    throw ConfigError("frames: expected 0 to " + std::to_string(frames - 1) + ", got " +
                      std::to_string(k));
}

TriangleMesh frozen_mesh(const World& world, int k, double period_s, double share) {
  check_frame(world.frames(period_s), k);
  TriangleMesh mesh = world.background();
  for (const MovingObject& o : world.objects_in_frame(k, period_s)) {
    const Box3d box = world.level.to_level(body_box(o.at(share)));
    const TriangleMesh& body = world.meshes->bodies[body_index(o.object_class)];
    const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
    const BoxFrame frame(box);
    for (const auto& v : body.vertices) {
      const Vec3 p = frame.from_box({v[0] * box.dx, v[1] * box.dy, v[2] * box.dz});
      mesh.vertices.push_back(
          {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)});
    }
    for (const auto& t : body.triangles) {
      mesh.triangles.push_back({first + t[0], first + t[1], first + t[2]});
      mesh.class_id.push_back(static_cast<std::uint16_t>(o.object_class));
    }
  }
  return mesh;
}

}  // namespace infrasim
