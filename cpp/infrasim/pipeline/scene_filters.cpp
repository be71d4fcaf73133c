#include "infrasim/pipeline/scene_filters.h"

#include <algorithm>

#include "infrasim/scene/lane_file.h"
#include "infrasim/scene/profile.h"

namespace infrasim {

namespace {

/// Height of the road at the sensor's foot: of the first, or of the nearest lane.
double road_z(const SceneConfig& scene) {
  const MountConfig& mount = scene.mounts.begin()->second;
  const Vec2 foot{mount.x_m, mount.y_m};
  if (!scene.roads.empty()) return scene.roads.front().elevation_m + Profile(scene).rise(foot);
  const std::vector<LaneLevel> lanes = lane_levels(scene, foot);
  return std::ranges::min(lanes, {}, &LaneLevel::away).z;
}

}  // namespace

std::vector<FilterStep> make_filters(const SceneConfig& scene,
                                     const std::function<std::vector<float>(int)>& empty_frame) {
  std::vector<FilterStep> steps;
  const auto add = [&]<class Filter>(const Filter& filter) {
    if constexpr (std::is_same_v<Filter, BackgroundFilter>) {
      std::vector<std::vector<float>> frames;
      for (int k = 0; k < filter.frames; ++k) frames.push_back(empty_frame(k));
      steps.emplace_back(learn_background(frames, filter));
    } else if constexpr (std::is_same_v<Filter, GroundPlane>) {
      GroundPlane plane = filter;
      if (plane.sensor_height_m == 0)
        plane.sensor_height_m = scene.mounts.begin()->second.z_m - road_z(scene);
      steps.emplace_back(plane);
    } else {
      steps.emplace_back(filter);
    }
  };
  for (const FilterConfig& f : scene.filters) std::visit(add, f.step);
  return steps;
}

}  // namespace infrasim
