#include "infrasim/pipeline/scene_filters.h"

#include <algorithm>
#include <cmath>

#include "infrasim/config/fields.h"

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

void check_filters(const Site& site, const std::string& name, const MountConfig& mount) {
  for (std::size_t i = 0; i < site.scene.filters.size(); ++i) {
    const FilterConfig& filter = site.scene.filters[i];
    const auto* plane = std::get_if<GroundPlane>(&filter.step);
    if (plane == nullptr || plane->sensor_height_m != 0) continue;
    if (const double height_m = mount.z_m - road_z(site, mount); height_m <= 0)
      config::fail(filter.place, "filters." + std::to_string(i) + ".ground_plane.sensor_height_m",
                   "expected the height of the sensor above the ground, because mount '" + name +
                       "' is not above the first road, got none; its height above this road is " +
                       config::number_text(std::round(height_m * 1000) / 1000) + " m");
  }
}

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
