#include "infrasim/pipeline/observer.h"

#include <algorithm>
#include <utility>

#include "infrasim/pipeline/world.h"
#include "infrasim/scene/sensor_rules.h"
#include "infrasim/scene/site_rules.h"
#include "infrasim/scene/state_source.h"

namespace infrasim {

namespace {

std::vector<bool> rows_with(std::span<const int> frames, int count) {
  std::vector<bool> rows(static_cast<std::size_t>(count) + 1);
  for (const int k : frames) {
    if (k < 0 || k >= count)
      throw ConfigError("frames: expected 0 to " + std::to_string(count - 1) + ", got " +
                        std::to_string(k));
    rows[static_cast<std::size_t>(k)] = rows[static_cast<std::size_t>(k) + 1] = true;
  }
  return rows;
}

}  // namespace

Observer::Observer(const SceneConfig& scene, const std::string& mount, std::span<const int> frames)
    : view_(scene_at_mount(scene, mount)), mount_(view_.mounts.begin()->first) {
  MountConfig& pose = view_.mounts[mount_];
  pose.clock_offset_s.reset();
  pose.own_random_stream.reset();
  view_.static_layers.reset();
  view_.filters.clear();
  site_ = std::make_shared<const Site>(checked_site(scene));
  region_.emplace(*site_, pose);
  const StateSource source(*site_);
  const std::vector<bool> rows = rows_with(frames, frame_count(scene.duration_s));
  const auto last = std::find(rows.rbegin(), rows.rend(), true);
  // Rows that are not requested are dropped, so that `check` knows the frames.
  TrajectoryKeeper keeper(rows, source.pitched(), 0);
  source.each([&](const auto& states) { keeper.take(states); },
              static_cast<int>(rows.rend() - last));
  trajectories_ = std::make_shared<const Trajectories>(keeper.finish());
  meshes_ = build_meshes(*site_);
}

std::string Observer::fault(const MountConfig& pose) const {
  try {
    check_sensor_at(*site_, mount_, pose);
    check_sensor_in_meshes(*site_, mount_, pose, meshes_->surface);
    SceneConfig scene;
    scene.mounts = {{mount_, pose}};
    for (std::size_t k = 0; k < trajectories_->rows.size(); ++k)
      check_sensor_is_free(scene, trajectories_->rows[k], static_cast<int>(k));
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "";
}

std::vector<std::vector<std::vector<Observation>>> Observer::observe(
    const MountConfig& pose, std::span<const LidarConfig> lidars,
    std::span<const int> frames) const {
  if (const std::string what = fault(pose); !what.empty()) throw ConfigError(what);
  for (const int k : frames) check(k);
  SceneConfig scene = view_;
  scene.mounts = {{mount_, pose}};
  World world = build_world_at(scene, site_, meshes_, trajectories_);
  world.region = *region_;
  const auto none = std::make_shared<const std::vector<FilterStep>>();
  FrameSimulator simulator(world, lidars, StaticLayers{}, LidarFilters(lidars.size(), none));
  std::vector<std::vector<std::vector<Observation>>> out;
  for (const int k : frames) out.push_back(simulator.observe(k));
  return out;
}

std::vector<MovingObject> Observer::present(int frame) const {
  check(frame);
  std::vector<MovingObject> objects = trajectories_->in_frame(frame);
  std::erase_if(objects, [&](const MovingObject& o) {
    const Box3d middle = o.at(0.5);
    return !region_->contains({middle.x, middle.y}, o.object_class);
  });
  return objects;
}

void Observer::check(int frame) const {
  const auto row = static_cast<std::size_t>(frame);
  const bool known =
      frame >= 0 && frame < trajectories_->frames() &&
      (trajectories_->whole() || (trajectories_->kept[row] && trajectories_->kept[row + 1]));
  if (!known)
    throw ConfigError("frames: expected frames of the observer, got " + std::to_string(frame));
}

}  // namespace infrasim
