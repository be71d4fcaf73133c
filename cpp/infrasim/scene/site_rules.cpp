#include "infrasim/scene/site_rules.h"

#include <algorithm>
#include <utility>

#include "infrasim/config/fields.h"
#include "infrasim/scene/obstacle_rules.h"
#include "infrasim/scene/sensor_rules.h"
#include "infrasim/scene/static_world.h"
#include "infrasim/scene/strips.h"

namespace infrasim {

namespace {

using config::number_text;

// m, minimum distance between two roads; nearer roads count as touching
constexpr double kApart = 0.01;
constexpr double kLeastDepth = 0.001;  // m, minimum depth of the ground below a road
constexpr int kSlopeSteps = 16;        // number of strips into which a slope is divided
constexpr double kMostVehicles =
    5'000;  // maximum number of vehicles; their states in 500 s need 2 GB

class RoadRules {
 public:
  explicit RoadRules(const Site& site) : site_(site) {
    for (std::size_t i = 0; i < site.centrelines.size(); ++i) {
      const double half = carriageway_half_width(site.scene.roads[i].lanes);
      roads_.add(cut_into_strips(site.centrelines[i], half, -half, i));
    }
  }

  void check() const {
    check_number_of_vehicles();
    for (std::size_t i = 0; i < site_.centrelines.size(); ++i) check_road_meets_none(i);
    for (const GroundConfig& ground : site_.scene.ground) check_ground(ground);
    for (std::size_t i = 0; i < site_.centrelines.size(); ++i) check_slopes(i);
  }

 private:
  void check_number_of_vehicles() const {
    if (!site_.scene.traffic) return;
    double length = 0;
    for (const Lane& lane : site_.network.lanes)
      if (lane.junction < 0) length += lane.curve.length();
    const double vehicles = site_.scene.traffic->vehicles_per_km_lane * length / 1000;
    if (vehicles > kMostVehicles)
      config::fail(site_.scene.traffic->place, "vehicles_per_km_lane",
                   "expected at most " + number_text(kMostVehicles) +
                       " vehicles on the scene's lanes, got " + number_text(std::round(vehicles)));
  }

  void check_road_meets_none(std::size_t i) const {
    const RoadConfig& road = site_.scene.roads[i];
    const double half = carriageway_half_width(road.lanes);
    const auto wide =
        cut_into_strips(site_.centrelines[i], half + kApart, -half - kApart, i, kApart);
    for (const Strip& strip : wide)
      if (const Strip* met = roads_.first_met(strip.outline, [&](const Strip& other) {
            return other.of < i && are_on_one_level(i, other.of) && !share_a_junction(strip, other);
          }))
        fail_meeting(road, *met, strip.middle());
    for (const Strip& strip :
         cut_into_strips(site_.centrelines[i], half - kApart, kApart - half, i))
      if (roads_.first_met(strip.outline, [&](const Strip& other) {
            return other.of == i && other.from > strip.to + kStripLength_m / 2;
          }) != nullptr)
        config::fail(road.place, "centreline",
                     "expected a road that does not cross itself, got a crossing near " +
                         at_text(strip.middle()));
    check_ends_apart(road, wide);
  }

  void check_ends_apart(const RoadConfig& road, const std::vector<Strip>& wide) const {
    if (wide.size() > 3 && footprints_overlap(wide.front().outline, wide.back().outline))
      config::fail(road.place, "centreline",
                   "expected a road with two ends, got a closed road near " +
                       at_text(wide.front().middle()));
  }

  bool are_on_one_level(std::size_t a, std::size_t b) const {
    return std::abs(site_.scene.roads[a].elevation_m - site_.scene.roads[b].elevation_m) <
           kClearance_m;
  }

  bool share_a_junction(const Strip& a, const Strip& b) const {
    const auto &cut_a = site_.network.cuts[a.of], &cut_b = site_.network.cuts[b.of];
    const auto within = [](const JunctionCut& cut, const Strip& strip) {
      const double middle = (strip.from + strip.to) / 2;
      return middle > cut.from && middle < cut.to;
    };
    return cut_a && cut_b && cut_a->junction == cut_b->junction && within(*cut_a, a) &&
           within(*cut_b, b);
  }

  [[noreturn]] void fail_meeting(const RoadConfig& road, const Strip& met, Vec2 place) const {
    const RoadConfig& other = site_.scene.roads[met.of];
    const double apart = std::abs(road.elevation_m - other.elevation_m);
    const std::string where = ", got an overlap with '" + other.name + "' near " + at_text(place);
    if (apart > 0)
      config::fail(road.place, "elevation_m",
                   "expected " + number_text(kClearance_m) +
                       " m or more between the heights of two roads" + where + " with " +
                       number_text(apart) + " m between");
    config::fail(road.place, "centreline",
                 "expected a junction of both roads, " + number_text(kClearance_m) +
                     " m of height difference, or " + number_text(kApart) + " m of distance" +
                     where + " without a junction");
  }

  void check_ground(const GroundConfig& ground) const {
    for (std::size_t i = 0; i < site_.centrelines.size(); ++i) {
      const RoadConfig& road = site_.scene.roads[i];
      const double lowest = road.elevation_m - (road.lanes.sidewalk_m > 0 ? kSidewalkDrop : 0);
      if (ground.elevation_m <= lowest - kLeastDepth) continue;
      if (ground.elevation_m >= road.elevation_m + kClearance_m) continue;
      const double half = outer_half_width(road.lanes);
      for (const Strip& strip : cut_into_strips(site_.centrelines[i], half, -half, i))
        if (footprints_overlap(strip.outline, ground.outline_m))
          config::fail(ground.place, "elevation_m",
                       "expected at most " + number_text(lowest - kLeastDepth) +
                           " below a road, or at least " +
                           number_text(road.elevation_m + kClearance_m) + " above it, got " +
                           number_text(ground.elevation_m) + " on '" + road.name + "' near " +
                           at_text(strip.middle()));
    }
  }

  /// Checks the slopes of a road in narrow strips, because the height changes across a slope.
  void check_slopes(std::size_t i) const {
    const RoadConfig& road = site_.scene.roads[i];
    if (!road.embankment) return;
    const double outer = outer_half_width(road.lanes), z = road.elevation_m;
    const double foot = road.embankment->foot_elevation_m;
    const double run = road.embankment->run_per_rise * std::abs(z - foot) / kSlopeSteps;
    for (const double side : {1.0, -1.0})
      for (int step = 0; step < kSlopeSteps; ++step) {
        const double a = side * (outer + run * step), b = side * (outer + run * (step + 1));
        const double from = z + (foot - z) * step / kSlopeSteps;
        const double to = z + (foot - z) * (step + 1) / kSlopeSteps;
        for (const Strip& strip :
             cut_into_strips(site_.centrelines[i], std::max(a, b), std::min(a, b), i))
          check_slope(road, strip, std::min(from, to), std::max(from, to));
      }
  }

  void check_slope(const RoadConfig& road, const Strip& slope, double low, double high) const {
    const Strip* met = roads_.first_met(slope.outline, [&](const Strip& strip) {
      const double level = site_.scene.roads[strip.of].elevation_m;
      return high > level && low < level + kClearance_m;
    });
    if (met != nullptr)
      config::fail(road.place, "embankment",
                   "expected slopes that cross no road, got a slope across '" +
                       site_.scene.roads[met->of].name + "' near " + at_text(met->middle()));
  }

  const Site& site_;
  StripIndex roads_;
};

}  // namespace

Site checked_site(const SceneConfig& scene) {
  Site site = build_site(scene);
  RoadRules(site).check();
  check_obstacles(site);
  for (const auto& [name, mount] : scene.mounts) check_sensor_at(site, name, mount);
  return site;
}

}  // namespace infrasim
