#include "infrasim/pipeline/scene_filters.h"

#include <algorithm>

namespace infrasim {

namespace {

/// Returns the height of the road below the sensor: of the first road or, without roads, of the
/// nearest lane.
double road_z(const Site& site, const MountConfig& mount) {
  const Vec2 foot{mount.x_m, mount.y_m};
  const std::vector<RoadConfig>& roads = site.scene.roads;
  if (!roads.empty()) return roads.front().elevation_m + site.profile.rise(foot);
  const std::vector<LaneLevel> lanes = lane_levels(site.lanes, foot);
  return std::ranges::min(lanes, {}, &LaneLevel::away).z;
}

}  // namespace

std::vector<FilterStep> make_filters(const Site& site, const MountConfig& mount,
                                     const std::function<std::vector<float>(int)>& empty_frame) {
  std::vector<FilterStep> steps;
  const auto add = [&]<class Filter>(const Filter& filter) {
    if constexpr (std::is_same_v<Filter, BackgroundFilter>) {
      std::vector<std::vector<float>> frames;
      for (int k = 0; k < filter.frames; ++k) frames.push_back(empty_frame(k));
      steps.emplace_back(learn_background(frames, filter));
    } else if constexpr (std::is_same_v<Filter, GroundPlane>) {
      GroundPlane plane = filter;
      if (plane.sensor_height_m == 0) plane.sensor_height_m = mount.z_m - road_z(site, mount);
      steps.emplace_back(plane);
    } else {
      steps.emplace_back(filter);
    }
  };
  for (const FilterConfig& f : site.scene.filters) std::visit(add, f.step);
  return steps;
}

}  // namespace infrasim
