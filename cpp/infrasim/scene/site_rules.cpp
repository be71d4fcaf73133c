#include "infrasim/scene/site_rules.h"

#include <algorithm>
#include <array>

#include "infrasim/config/fields.h"
#include "infrasim/config/lidar_config.h"
#include "infrasim/scene/lane_file.h"
#include "infrasim/scene/lane_network.h"
#include "infrasim/scene/outline_index.h"
#include "infrasim/scene/parked.h"
#include "infrasim/scene/people.h"
#include "infrasim/scene/sensor_rules.h"
#include "infrasim/scene/static_world.h"
#include "infrasim/scene/vegetation.h"

namespace infrasim {

namespace {

using config::number_text;

constexpr double kStep = 2;            // m, length of the strips that roads and lanes are cut into
constexpr double kApart = 0.01;        // m between two roads, else they abut
constexpr double kLeastDepth = 0.001;  // m from a road down to the ground
constexpr int kSlopeSteps = 16;        // that a slope is looked at in
constexpr double kMostRoad = 100'000;  // m: rays end at 5 km, and vehicles take time everywhere
constexpr double kPeopleBeside_m = 1.2;  // to each side of their line, that they need to pass
constexpr double kPeopleHeight_m = 2.5;  // that is free over their line
constexpr double kMostVehicles = 5'000;  // of traffic: a gigabyte of trajectories in 500 s

std::string at_text(Vec2 p) {
  const auto n = [](double v) { return number_text(std::round(v * 10) / 10); };
  return "x " + n(p.x) + ", y " + n(p.y);
}

/// A piece of a road, lane or slope between two stations of its line.
struct Strip {
  std::array<Vec2, 4> outline;  ///< counter-clockwise
  double from = 0;
  double to = 0;
  std::size_t of = 0;  ///< road or lane

  Vec2 middle() const { return 0.5 * (outline[0] + outline[2]); }
};

/// The surface between two lines beside a curve; `longer` metres are added at both of its ends.
std::vector<Strip> cut_into_strips(const Curve& curve, double left_m, double right_m,
                                   std::size_t of, double longer = 0) {
  std::vector<Strip> out;
  const double length = curve.length();
  const auto side = [&](double s, double offset, double beyond) {
    const CurvePoint p = curve.at(s);
    return p.position + offset * heading_vector(p.heading + kPi / 2) +
           beyond * heading_vector(p.heading);
  };
  const auto n = static_cast<int>(std::max(1.0, std::ceil(length / kStep)));
  for (int i = 0; i < n; ++i) {
    const double from = length * i / n, to = length * (i + 1) / n;
    const double before = i == 0 ? -longer : 0, after = i + 1 == n ? longer : 0;
    out.push_back({{side(from, right_m, before), side(to, right_m, after), side(to, left_m, after),
                    side(from, left_m, before)},
                   from,
                   to,
                   of});
  }
  return out;
}

/// The first strip of an index that an outline meets, and that is `wanted`.
template <class Wanted>
const Strip* first_met(const OutlineIndex& index, const std::vector<Strip>& strips,
                       std::span<const Vec2> outline, const Wanted& wanted) {
  const Strip* met = nullptr;
  index.any_near(outline, [&](std::size_t i) {
    if (!wanted(strips[i]) || !footprints_overlap(outline, strips[i].outline)) return false;
    met = &strips[i];
    return true;
  });
  return met;
}

class Site {
 public:
  explicit Site(const SceneConfig& scene) : scene_(scene), paths_(lanes_of(scene)) {
    check_size();
    network_ = build_lane_network(scene);
    check_number_of_vehicles();
    for (std::size_t i = 0; i < scene.roads.size(); ++i) {
      const double half = carriageway_half_width(scene.roads[i].lanes);
      add(cut_into_strips(lines_[i], half, -half, i), roads_, roads_index_);
    }
    for (std::size_t i = 0; i < network_.lanes.size(); ++i) {
      const double half = network_.lanes[i].width_m / 2;
      add(cut_into_strips(network_.lanes[i].curve, half, -half, i), lanes_, lanes_index_);
    }
    for (std::size_t i = 0; i < paths_.size(); ++i) {
      const double half = std::ranges::max(paths_[i].width_m) / 2;
      add(cut_into_strips(paths_[i].line, half, -half, i), path_strips_, paths_index_);
    }
  }

  void check() const {
    for (std::size_t i = 0; i < lines_.size(); ++i) check_road_meets_none(i);
    for (const GroundConfig& ground : scene_.ground) check_ground(ground);
    for (std::size_t i = 0; i < lines_.size(); ++i) check_slopes(i);
    for (const BarrierConfig& barrier : scene_.barriers) check_barrier(barrier);
    for (const Upright& upright : uprights(scene_))
      check_beside_lanes(upright.box, upright.place, upright.key, "");
    for (const LeafVolume& leaves : leaf_volumes(scene_))
      check_beside_lanes(leaves.box, leaves.place, leaves.key, leaves.kind);
    check_parked();
    check_people();
  }

 private:
  static void add(const std::vector<Strip>& more, std::vector<Strip>& strips, OutlineIndex& index) {
    for (const Strip& strip : more) {
      index.add(strip.outline, strips.size());
      strips.push_back(strip);
    }
  }

  // --- size -------------------------------------------------------------------------------------

  void check_size() {
    double length = 0;
    for (const RoadConfig& road : scene_.roads) {
      for (const CentrelinePiece& piece : road.centreline)
        length += piece.line_m + piece.radius_m * rad(std::abs(piece.turn_deg));
      if (length > kMostRoad)
        config::fail(road.place, "centreline",
                     "found " + number_text(std::round(length)) +
                         " m of roads up to this one, allowed " + number_text(kMostRoad) +
                         ", as rays end at " + number_text(kLongestRange_m));
      lines_.push_back(centreline(road));
    }
  }

  void check_number_of_vehicles() const {
    if (!scene_.traffic) return;
    double length = 0;
    for (const Lane& lane : network_.lanes)
      if (lane.junction < 0) length += lane.curve.length();
    const double vehicles = scene_.traffic->vehicles_per_km_lane * length / 1000;
    if (vehicles > kMostVehicles)
      config::fail(scene_.traffic->place, "vehicles_per_km_lane",
                   "found " + number_text(std::round(vehicles)) +
                       " vehicles on the scene's lanes, allowed " + number_text(kMostVehicles));
  }

  // --- roads ------------------------------------------------------------------------------------

  void check_road_meets_none(std::size_t i) const {
    const RoadConfig& road = scene_.roads[i];
    const double half = carriageway_half_width(road.lanes);
    const auto wide = cut_into_strips(lines_[i], half + kApart, -half - kApart, i, kApart);
    for (const Strip& strip : wide)
      if (const Strip* met =
              first_met(roads_index_, roads_, strip.outline, [&](const Strip& other) {
                return other.of < i && are_on_one_level(i, other.of) &&
                       !share_a_junction(strip, other);
              }))
        fail_meeting(road, *met, strip.middle());
    for (const Strip& strip : cut_into_strips(lines_[i], half - kApart, kApart - half, i))
      if (first_met(roads_index_, roads_, strip.outline, [&](const Strip& other) {
            return other.of == i && other.from > strip.to + kStep / 2;
          }) != nullptr)
        config::fail(road.place, "centreline",
                     "found it to cross itself near " + at_text(strip.middle()) +
                         ", allowed a road that does not");
    check_ends_apart(road, wide);
  }

  void check_ends_apart(const RoadConfig& road, const std::vector<Strip>& wide) const {
    if (wide.size() > 3 && footprints_overlap(wide.front().outline, wide.back().outline))
      config::fail(road.place, "centreline",
                   "found it to end where it starts, near " + at_text(wide.front().middle()) +
                       ", allowed a road with two ends");
  }

  bool are_on_one_level(std::size_t a, std::size_t b) const {
    return std::abs(scene_.roads[a].elevation_m - scene_.roads[b].elevation_m) < kClearance_m;
  }

  bool share_a_junction(const Strip& a, const Strip& b) const {
    const auto &cut_a = network_.cuts[a.of], &cut_b = network_.cuts[b.of];
    const auto within = [](const JunctionCut& cut, const Strip& strip) {
      const double middle = (strip.from + strip.to) / 2;
      return middle > cut.from && middle < cut.to;
    };
    return cut_a && cut_b && cut_a->junction == cut_b->junction && within(*cut_a, a) &&
           within(*cut_b, b);
  }

  [[noreturn]] void fail_meeting(const RoadConfig& road, const Strip& met, Vec2 place) const {
    const RoadConfig& other = scene_.roads[met.of];
    const double apart = std::abs(road.elevation_m - other.elevation_m);
    const std::string where = "found it on '" + other.name + "' near " + at_text(place);
    if (apart > 0)
      config::fail(road.place, "elevation_m",
                   where + " with " + number_text(apart) + " m of height between, allowed " +
                       number_text(kClearance_m) + " or more");
    config::fail(road.place, "centreline",
                 where + " without a junction of both, allowed one, " + number_text(kClearance_m) +
                     " m of height between, or " + number_text(kApart) + " m beside it");
  }

  // --- ground -----------------------------------------------------------------------------------

  void check_ground(const GroundConfig& ground) const {
    for (std::size_t i = 0; i < lines_.size(); ++i) {
      const RoadConfig& road = scene_.roads[i];
      const double lowest = road.elevation_m - (road.lanes.sidewalk_m > 0 ? kSidewalkDrop : 0);
      if (ground.elevation_m <= lowest - kLeastDepth) continue;
      if (ground.elevation_m >= road.elevation_m + kClearance_m) continue;
      const double half = outer_half_width(road.lanes);
      for (const Strip& strip : cut_into_strips(lines_[i], half, -half, i))
        if (footprints_overlap(strip.outline, ground.outline_m))
          config::fail(ground.place, "elevation_m",
                       "found " + number_text(ground.elevation_m) + " on '" + road.name +
                           "' near " + at_text(strip.middle()) + ", allowed up to " +
                           number_text(lowest - kLeastDepth) + ", or from " +
                           number_text(road.elevation_m + kClearance_m) + " above it");
    }
  }

  /// A slope is looked at in narrow strips, each with its own heights.
  void check_slopes(std::size_t i) const {
    const RoadConfig& road = scene_.roads[i];
    if (!road.embankment) return;
    const double outer = outer_half_width(road.lanes), z = road.elevation_m;
    const double foot = road.embankment->foot_elevation_m;
    const double run = road.embankment->run_per_rise * std::abs(z - foot) / kSlopeSteps;
    for (const double side : {1.0, -1.0})
      for (int step = 0; step < kSlopeSteps; ++step) {
        const double a = side * (outer + run * step), b = side * (outer + run * (step + 1));
        const double from = z + (foot - z) * step / kSlopeSteps;
        const double to = z + (foot - z) * (step + 1) / kSlopeSteps;
        for (const Strip& strip : cut_into_strips(lines_[i], std::max(a, b), std::min(a, b), i))
          check_slope(road, strip, std::min(from, to), std::max(from, to));
      }
  }

  void check_slope(const RoadConfig& road, const Strip& slope, double low, double high) const {
    const Strip* met = first_met(roads_index_, roads_, slope.outline, [&](const Strip& strip) {
      const double level = scene_.roads[strip.of].elevation_m;
      return high > level && low < level + kClearance_m;
    });
    if (met != nullptr)
      config::fail(road.place, "embankment",
                   "found its slope on '" + scene_.roads[met->of].name + "' near " +
                       at_text(met->middle()) + ", allowed below roads and beside them");
  }

  // --- what stands there ------------------------------------------------------------------------

  /// True if the box is in the space over a lane that vehicles need.
  bool stands_on_lane(const Box3d& box) const {
    const double low = box.z - box.dz / 2, high = box.z + box.dz / 2;
    const auto in_way = [&](double level) { return high > level && low < level + kClearance_m; };
    const auto on_lane = [&](const Strip& strip) {
      return in_way(network_.lanes[strip.of].elevation_m);
    };
    const auto on_path = [&](const Strip& strip) {
      const LanePath& path = paths_[strip.of];
      return in_way(path.at(path.z, (strip.from + strip.to) / 2));
    };
    return first_met(lanes_index_, lanes_, footprint(box), on_lane) != nullptr ||
           first_met(paths_index_, path_strips_, footprint(box), on_path) != nullptr;
  }

  void check_barrier(const BarrierConfig& barrier) const {
    for (const Box3d& piece : barrier_pieces(scene_, barrier))
      if (stands_on_lane(piece))
        config::fail(barrier.place, "offset_m",
                     "found a barrier on a lane, allowed the median or outside the lanes");
  }

  void check_beside_lanes(const Box3d& box, const config::Place& place, const char* key,
                          const std::string& kind) const {
    if (stands_on_lane(box))
      config::fail(place, key,
                   "found " + (kind.empty() ? "it" : kind) +
                       " on a lane, allowed beside the lanes or " + number_text(kClearance_m) +
                       " m above them");
  }

  /// What rays and vehicles do not pass, plants but for their trunks left out.
  std::vector<Box3d> solids() const {
    std::vector<Box3d> solid;
    for (const Upright& upright : uprights(scene_)) solid.push_back(upright.box);
    for (const BarrierConfig& barrier : scene_.barriers)
      for (const Box3d& piece : barrier_pieces(scene_, barrier)) solid.push_back(piece);
    return solid;
  }

  /// Parked vehicles stand beside the lanes, and where nothing else does.
  void check_parked() const {
    const std::vector<ParkedVehicle> parked = parked_vehicles(scene_);
    if (parked.empty()) return;
    std::vector<Box3d> solid = solids();
    OutlineIndex index;
    for (std::size_t i = 0; i < solid.size(); ++i) index.add(footprint(solid[i]), i);
    for (const auto& [vehicle, place] : parked) {
      const Box3d& box = vehicle.box;
      check_beside_lanes(box, place, "offset_m", "a parked vehicle");
      const auto outline = footprint(box);
      const auto shares_place = [&](std::size_t i) {
        const Box3d& other = solid[i];
        return std::abs(box.z - other.z) < (box.dz + other.dz) / 2 &&
               footprints_overlap(outline, footprint(other));
      };
      if (index.any_near(outline, shares_place))
        config::fail(place, "offset_m",
                     "found a parked vehicle in another, or in what stands there, near " +
                         at_text({box.x, box.y}) + ", allowed where nothing is");
      index.add(outline, solid.size());
      solid.push_back(box);
    }
  }

  /// People go beside the lanes of traffic, and where nothing stands and no other row goes.
  void check_people() const {
    if (!scene_.people && !scene_.standing_people) return;
    std::vector<Box3d> solid = solids();
    for (const ParkedVehicle& vehicle : parked_vehicles(scene_)) solid.push_back(vehicle.state.box);
    OutlineIndex index;
    for (std::size_t i = 0; i < solid.size(); ++i) index.add(footprint(solid[i]), i);
    const auto is_taken = [&](const Box3d& box) {
      const auto outline = footprint(box);
      return index.any_near(outline, [&](std::size_t i) {
        const Box3d& other = solid[i];
        return std::abs(box.z - other.z) < (box.dz + other.dz) / 2 &&
               footprints_overlap(outline, footprint(other));
      });
    };
    const auto take = [&](const Box3d& box) {
      index.add(footprint(box), solid.size());
      solid.push_back(box);
    };
    for (const PeopleConfig& row : scene_.people.value_or(std::vector<PeopleConfig>{})) {
      const std::vector<Box3d> way = free_way(row);
      for (const Box3d& box : way) {
        if (scene_.traffic) check_beside_lanes(box, row.place, "offset_m", "people");
        if (is_taken(box))
          config::fail(row.place, "offset_m",
                       "found something in the way of people, near " + at_text({box.x, box.y}) +
                           ", allowed " + number_text(kPeopleBeside_m) +
                           " m free to both sides of their line");
      }
      for (const Box3d& box : way) take(box);
    }
    for (const StandingPeopleConfig& group :
         scene_.standing_people.value_or(std::vector<StandingPeopleConfig>{})) {
      const double side = 2 * radius_of(group);
      const Box3d box{group.x_m,       group.y_m, group.base_m + kPeopleHeight_m / 2, side, side,
                      kPeopleHeight_m, 0};
      if (scene_.traffic) check_beside_lanes(box, group.place, "x_m", "standing people");
      if (is_taken(box))
        config::fail(group.place, "x_m",
                     "expected free ground within " + number_text(radius_of(group)) +
                         " m of the group's middle, got something that stands or walks there");
      take(box);
    }
  }

  /// What a row of people needs for itself, in pieces of 2 m.
  std::vector<Box3d> free_way(const PeopleConfig& row) const {
    const Curve line = people_line(scene_, row);
    const double z = scene_.roads[road_index(scene_, row.road, row.place, "road")].elevation_m;
    std::vector<Box3d> boxes;
    for (double s = 0; s < line.length(); s += kStep) {
      const double length = std::min(kStep, line.length() - s);
      const CurvePoint p = line.at(s + length / 2);
      boxes.push_back({p.position.x, p.position.y, z + kPeopleHeight_m / 2, length,
                       2 * kPeopleBeside_m, kPeopleHeight_m, p.heading});
    }
    return boxes;
  }

  const SceneConfig& scene_;
  LaneNetwork network_;
  std::vector<Curve> lines_;     ///< of the roads
  std::vector<LanePath> paths_;  ///< of the file of lanes
  std::vector<Strip> roads_, lanes_, path_strips_;
  OutlineIndex roads_index_, lanes_index_, paths_index_;
};

}  // namespace

void check_site(const SceneConfig& scene) {
  Site(scene).check();
  check_sensor(scene);
}

}  // namespace infrasim
