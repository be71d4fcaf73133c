#include "infrasim/scene/region.h"

#include <algorithm>
#include <iterator>
#include <optional>
#include <set>
#include <utility>

#include "infrasim/config/fields.h"
#include "infrasim/core/errors.h"
#include "infrasim/core/math.h"
#include "infrasim/core/numbers.h"

namespace infrasim {

namespace {

constexpr double kRounding_m = 0.01;  // m, larger than the rounding error of a distance

}  // namespace

EvaluationRegion::EvaluationRegion(const Site& site, const MountConfig& mount)
    : outlines_(site.scene.regions.value_or(std::vector<RegionConfig>{})),
      half_length_(site.scene.region_half_length_m),
      profile_(site.profile) {
  const SceneConfig& scene = site.scene;
  const Vec2 foot{mount.x_m, mount.y_m};
  for (std::size_t i = 0; i < scene.roads.size(); ++i) {
    const RoadConfig& road = scene.roads[i];
    Curve along = site.centrelines[i];
    const double heading = along.at(along.project(foot)).heading;
    if (math::cos(heading - rad(mount.yaw_deg)) < 0) along = along.reversed();
    const double station = along.project(foot);
    add_road(road.name, std::move(along), station, road.elevation_m,
             carriageway_half_width(road.lanes));
  }
  for (const std::optional<Ring>& ring : site.network.rings) {
    if (!ring) continue;
    Curve along = ring->line(foot);
    const double station = along.length() / 2;  // station of the point nearest to the foot
    add_road(ring->name, std::move(along), station, ring->elevation_m, ring->config.width_m / 2);
  }
  for (const LanePath& lane : site.lanes) {
    std::vector<LanePart> parts = parts_within(lane, foot, half_length_);
    std::ranges::move(parts, std::back_inserter(parts_));
  }
  if (scene.lanes && parts_.empty())
    throw ConfigError((scene.folder / *scene.lanes).string() + ": expected a lane within " +
                      config::number_text(half_length_) + " m of the mount, got none");
  check_names(scene);
  check_outlines(scene);
}

void EvaluationRegion::add_road(const std::string& name, Curve along, double foot, double elevation,
                                double half_width) {
  const double from = std::max(0.0, foot - half_length_);
  const double to = std::min(along.length(), foot + half_length_);
  const double widest = half_width + kFootways_m + kRounding_m;
  Vec2 low{kInf, kInf}, high{-kInf, -kInf};
  const auto take = [&](Vec2 place) {
    low = {std::min(low.x, place.x - widest), std::min(low.y, place.y - widest)};
    high = {std::max(high.x, place.x + widest), std::max(high.y, place.y + widest)};
  };
  take(along.at(from).position);
  take(along.at(to).position);
  const auto& stations = along.stations();
  const auto first = std::ranges::lower_bound(stations, from) - stations.begin();
  const auto last = std::ranges::upper_bound(stations, to) - stations.begin();
  for (auto i = first; i < last; ++i) take(along.samples()[static_cast<std::size_t>(i)].position);
  CurveGrid grid(along, low, high, widest);
  roads_.push_back({name, std::move(along), foot, elevation, half_width, std::move(grid)});
}

template <class Take>
void EvaluationRegion::for_each_row(const Take& take) const {
  for (const RoadPart& road : roads_) {
    const double first = std::ceil(std::max(-half_length_, -road.foot)) + 0.0;  // turns -0 into 0
    const double last = std::min(half_length_, road.along.length() - road.foot);
    for (double s = first; s <= last; s += 1) {
      const CurvePoint p = road.along.at(road.foot + s);
      take(road.name, LaneRow{s, p.position, road.elevation + profile_.rise(p.position),
                              wrap_angle(p.heading), road.half_width});
    }
  }
  for (const LanePart& part : parts_)
    for (const LaneRow& row : part.rows) take(part.name, row);
}

/// Checks that the names of the region's parts are unique. Rows with the same name form one road.
void EvaluationRegion::check_names(const SceneConfig& scene) const {
  std::set<std::string> names;
  for (const LanePart& part : parts_)
    if (!names.insert(part.name).second)
      throw ConfigError((scene.folder / *scene.lanes).string() +
                        ": expected a different name for each part of a lane in the region, got '" +
                        part.name +
                        "' twice; further parts of a lane are named NAME_2, NAME_3 ...");
}

void EvaluationRegion::check_outlines(const SceneConfig& scene) const {
  if (outlines_.empty()) return;
  bool meet = false;
  for_each_row([&](const std::string&, const LaneRow& row) { meet |= in_outlines(row.place); });
  if (!meet)
    config::fail(scene.regions->front().place, "regions.0.outline_m",
                 "expected outlines that contain the middle of a road or lane, got none within " +
                     config::number_text(half_length_) + " m of the mount");
}

bool EvaluationRegion::in_outlines(Vec2 point) const {
  return outlines_.empty() || std::ranges::any_of(outlines_, [&](const RegionConfig& region) {
           return encloses(region.outline_m, point);
         });
}

bool EvaluationRegion::contains(Vec2 point, Class object_class) const {
  if (!in_outlines(point)) return false;
  const double beside = class_of(object_class).vehicle ? 0 : kFootways_m;
  if (std::ranges::any_of(parts_,
                          [&](const LanePart& part) { return part.contains(point, beside); }))
    return true;
  return std::ranges::any_of(roads_, [&](const RoadPart& road) {
    const std::optional<double> station = road.grid.project(road.along, point);
    return station && std::abs(*station - road.foot) <= half_length_ &&
           norm(point - road.along.at(*station).position) <= road.half_width + beside;
  });
}

std::string EvaluationRegion::roads_csv() const {
  std::string text = "road,s,x,y,z,heading,half_width\n";
  for_each_row([&](const std::string& name, const LaneRow& row) {
    text += name + "," + config::number_text(row.s);
    for (const auto& [value, digits] :
         {std::pair{row.place.x, 4}, std::pair{row.place.y, 4}, std::pair{row.z, 4},
          std::pair{row.heading, 6}, std::pair{row.half_width, 4}}) {
      text += ',';
      append_fixed(text, value, digits);
    }
    text += '\n';
  });
  return text;
}

std::string EvaluationRegion::regions_csv() const {
  if (outlines_.empty()) return "";
  std::string text = "region,x,y\n";
  for (const RegionConfig& region : outlines_)
    for (const Vec2& corner : region.outline_m)
      text += region.name + "," + config::number_text(corner.x) + "," +
              config::number_text(corner.y) + "\n";
  return text;
}

}  // namespace infrasim
