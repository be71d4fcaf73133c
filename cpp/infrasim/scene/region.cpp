#include "infrasim/scene/region.h"

#include <algorithm>
#include <array>
#include <cstdio>

#include "infrasim/scene/lane_network.h"

namespace infrasim {

EvaluationRegion::EvaluationRegion(const SceneConfig& scene)
    : half_length_(scene.region_half_length_m) {
  const MountConfig& mount = scene.mounts.begin()->second;
  const Vec2 foot{mount.x_m, mount.y_m};
  for (const RoadConfig& road : scene.roads) {
    Curve along = centreline(road);
    const double heading = along.at(along.project(foot)).heading;
    if (std::cos(heading - rad(mount.yaw_deg)) < 0) along = along.reversed();
    const double station = along.project(foot);
    roads_.push_back({road.name, std::move(along), station, road.elevation_m,
                      carriageway_half_width(road.lanes)});
  }
}

bool EvaluationRegion::contains(Vec2 point, Class object_class) const {
  const double beside = class_of(object_class).vehicle ? 0 : kFootways_m;
  return std::ranges::any_of(roads_, [&](const Road& road) {
    const double station = road.along.project(point);
    return std::abs(station - road.foot) <= half_length_ &&
           norm(point - road.along.at(station).position) <= road.half_width + beside;
  });
}

std::string EvaluationRegion::roads_csv() const {
  std::string text = "road,s,x,y,z,heading,half_width\n";
  std::array<char, 256> line{};
  for (const Road& road : roads_) {
    const double first = std::ceil(std::max(-half_length_, -road.foot)) + 0.0;  // not -0
    const double last = std::min(half_length_, road.along.length() - road.foot);
    for (double s = first; s <= last; s += 1) {
      const CurvePoint p = road.along.at(road.foot + s);
      std::snprintf(line.data(), line.size(), "%s,%.0f,%.4f,%.4f,%.4f,%.6f,%.4f\n",
                    road.name.c_str(), s, p.position.x, p.position.y, road.elevation,
                    wrap_angle(p.heading), road.half_width);
      text += line.data();
    }
  }
  return text;
}

}  // namespace infrasim
