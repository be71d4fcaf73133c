#include "infrasim/pipeline/observer.h"

#include <algorithm>
#include <utility>

#include "infrasim/config/fields.h"
#include "infrasim/pipeline/world.h"
#include "infrasim/scene/sensor_rules.h"
#include "infrasim/scene/site_rules.h"
#include "infrasim/scene/state_source.h"

namespace infrasim {

Observer::Observer(const SceneConfig& scene, const std::string& mount, std::span<const int> frames,
                   double period_s)
    : period_s_(period_s) {
  const SceneConfig view = scene_at_mount(scene, mount);
  const auto& [name, pose] = *view.mounts.begin();
  mount_ = name;
  site_ = std::make_shared<const Site>(checked_site(scene));
  region_.emplace(*site_, pose);
  const StateSource source(*site_);
  for (const int k : frames) check_frame(frame_count(scene.duration_s, period_s), k);
  const std::vector<bool> rows = rows_of_frames(frames, period_s, row_steps(scene.duration_s));
  const auto last = std::find(rows.rbegin(), rows.rend(), true);
  // Trajectory rows that the given frames do not need are dropped. `check` therefore finds frames
  // that can't be observed.
  TrajectoryKeeper keeper(rows, source.pitched(), 0);
  StateSteps steps(source);
  for (std::ptrdiff_t k = 0; k < rows.rend() - last; ++k) keeper.take(steps.next_moving());
  auto trajectories = std::make_shared<Trajectories>(keeper.finish());
  trajectories->standing = source.standing();
  trajectories_ = std::move(trajectories);
  meshes_ = build_meshes(*site_);
}

std::string Observer::fault(const MountConfig& pose) const {
  try {
    check_sensor_at(*site_, mount_, pose);
    check_sensor_in_meshes(*site_, mount_, pose, meshes_->surface);
    SceneConfig scene;
    scene.mounts = {{mount_, pose}};
    check_sensor_is_free(scene, trajectories_->standing, 0);
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
  for (const LidarConfig& lidar : lidars)
    if (infrasim::period_s(lidar) != period_s_)
      throw ConfigError(lidar.name + ": expected the observer's frame period of " +
                        config::number_text(period_s_) + " s, got " +
                        config::number_text(infrasim::period_s(lidar)) + " s");
  SceneConfig scene = site_->scene;
  scene.mounts = {{mount_, pose}};
  scene.static_layers.reset();
  scene.filters.clear();
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
  std::vector<MovingObject> objects = trajectories_->between(row_position(frame * period_s_),
                                                             row_position((frame + 1) * period_s_));
  std::erase_if(objects, [&](const MovingObject& o) {
    const Box3d middle = o.at(0.5);
    return !region_->contains({middle.x, middle.y}, o.object_class);
  });
  return objects;
}

void Observer::check(int frame) const {
  const bool known = frame >= 0 && frame < frame_count(site_->scene.duration_s, period_s_) &&
                     trajectories_->has(row_position(frame * period_s_)) &&
                     trajectories_->has(row_position((frame + 1) * period_s_));
  if (!known)
    throw ConfigError("frames: expected a frame for which the observer was made, got " +
                      std::to_string(frame));
}

}  // namespace infrasim
