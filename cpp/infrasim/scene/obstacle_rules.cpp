#include "infrasim/scene/obstacle_rules.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "infrasim/config/fields.h"
#include "infrasim/core/classes.h"
#include "infrasim/scene/people.h"
#include "infrasim/scene/strips.h"

namespace infrasim {

namespace {

using config::number_text;

constexpr double kPeopleBeside_m = 1.2;  // free width needed on each side of a line of people
constexpr double kPeopleHeight_m = 2.5;  // free height needed over a line of people
constexpr double kPeopleStep_m = 2;      // length of the boxes in which a line is checked
constexpr int kMostShift_cm = 1000;      // maximum shift of parked vehicles that a message proposes

/// Upright boxes, which other boxes must not overlap.
class Obstacles {
 public:
  void add(const Box3d& box) {
    index_.add(footprint(box), boxes_.size());
    boxes_.push_back(box);
  }
  bool meet(const Box3d& box) const {
    const auto outline = footprint(box);
    return index_.any_near(outline, [&](std::size_t i) {
      const Box3d& other = boxes_[i];
      return std::abs(box.z - other.z) < (box.dz + other.dz) / 2 &&
             footprints_overlap(outline, footprint(other));
    });
  }

 private:
  std::vector<Box3d> boxes_;
  OutlineIndex index_;
};

class ObstacleRules {
 public:
  explicit ObstacleRules(const Site& site) : site_(site) {
    const std::vector<Lane>& lanes = site.network.lanes;
    for (std::size_t i = 0; i < lanes.size(); ++i) {
      const double half = lanes[i].width_m / 2;
      lanes_.add(cut_into_strips(lanes[i].curve, half, -half, i));
    }
    for (std::size_t i = 0; i < site.lanes.size(); ++i) {
      const double half = std::ranges::max(site.lanes[i].width_m) / 2;
      paths_.add(cut_into_strips(site.lanes[i].line, half, -half, i));
    }
  }

  void check() const {
    for (std::size_t i = 0; i < site_.barriers.size(); ++i)
      check_barrier(site_.scene.barriers[i], site_.barriers[i]);
    for (const StaticBox& solid : site_.boxes)
      check_beside_lanes(solid.box, solid.place, solid.key, "");
    for (const LeafVolume& leaves : site_.leaves)
      check_beside_lanes(leaves.box, leaves.place, leaves.key, leaves.kind);
    check_parked();
    check_people();
  }

 private:
  /// Returns whether the box lies in the space over a lane that vehicles need.
  bool stands_on_lane(const Box3d& box) const {
    const double low = box.z - box.dz / 2, high = box.z + box.dz / 2;
    const auto in_way = [&](double level) { return high > level && low < level + kClearance_m; };
    const auto on_lane = [&](const Strip& strip) {
      return in_way(site_.network.lanes[strip.of].elevation_m);
    };
    const auto on_path = [&](const Strip& strip) {
      const LanePath& path = site_.lanes[strip.of];
      return in_way(path.at(path.z, (strip.from + strip.to) / 2));
    };
    const auto outline = footprint(box);
    return lanes_.first_met(outline, on_lane) != nullptr ||
           paths_.first_met(outline, on_path) != nullptr;
  }

  void check_barrier(const BarrierConfig& barrier, const std::vector<Box3d>& pieces) const {
    for (const Box3d& piece : pieces)
      if (stands_on_lane(piece))
        config::fail(
            barrier.place, "offset_m",
            "expected a position on the median or beside the lanes, got a barrier on a lane");
  }

  void check_beside_lanes(const Box3d& box, const config::Place& place, const char* key,
                          const std::string& kind) const {
    if (stands_on_lane(box))
      config::fail(place, key,
                   "expected a position beside the lanes or " + number_text(kClearance_m) +
                       " m above them, got " + (kind.empty() ? "an object" : kind) + " on a lane");
  }

  /// Returns all solid objects, including barriers and trunks, but not leaves.
  Obstacles solids() const {
    Obstacles solid;
    for (const StaticBox& box : site_.boxes) solid.add(box.box);
    for (const std::vector<Box3d>& pieces : site_.barriers)
      for (const Box3d& piece : pieces) solid.add(piece);
    return solid;
  }

  /// Describes a parked vehicle by its class and its size, which depends on the seed.
  std::string described(const ObjectState& vehicle) const {
    const auto metres = [](double m) { return number_text(std::round(100 * m) / 100); };
    return "a " + std::string(class_of(vehicle.object_class).name) + " " + metres(vehicle.box.dx) +
           " m long and " + metres(vehicle.box.dy) + " m wide with seed " +
           std::to_string(site_.scene.seed);
  }

  /// Returns how far a parked vehicle must be moved away from its road's centreline to be beside
  /// the lanes, or kMostShift_cm if that is not enough.
  int needed_shift_cm(Box3d box, const ParkedConfig& row) const {
    const Curve& line = road_named(site_.scene, site_.centrelines, row.road, row.place).centreline;
    const double heading = line.at(line.project({box.x, box.y})).heading;
    const Vec2 step = (row.offset_m < 0 ? -0.01 : 0.01) * heading_vector(heading + kPi / 2);
    int cm = 0;
    for (; cm < kMostShift_cm && stands_on_lane(box); ++cm) {
      box.x += step.x;
      box.y += step.y;
    }
    return cm;
  }

  /// Reports a row of parked vehicles on a lane, with the offset that the row needs.
  /// @param first the first vehicle of the row that is on a lane
  [[noreturn]] void fail_on_lane(const ParkedVehicle& first) const {
    SceneConfig scene = site_.scene;
    ParkedConfig& row = (*scene.parked)[first.row];
    const ParkedConfig given = row;
    std::string outermost;
    // The whole row is parked again at each offset. In a bend, another offset also moves vehicles
    // along the road.
    while (std::abs(row.offset_m) <= std::abs(given.offset_m) + kMostShift_cm / 100.0) {
      int most_cm = 0;
      for (const ParkedVehicle& vehicle : parked_vehicles(scene, site_.centrelines)) {
        const int cm = vehicle.row == first.row ? needed_shift_cm(vehicle.state.box, row) : 0;
        if (cm <= most_cm) continue;
        most_cm = cm;
        outermost = described(vehicle.state);
      }
      if (most_cm == 0)
        config::fail(given.place, "offset_m",
                     "expected " + number_text(std::abs(row.offset_m)) +
                         " m or more from the centreline for " + outermost + ", got " +
                         number_text(given.offset_m));
      row.offset_m = std::copysign(std::ceil(100 * std::abs(row.offset_m) + most_cm - 1e-6) / 100,
                                   row.offset_m);
    }
    const Box3d& box = first.state.box;
    config::fail(given.place, "offset_m",
                 "expected a position beside the lanes or " + number_text(kClearance_m) +
                     " m above them, got " + described(first.state) + " on a lane near " +
                     at_text({box.x, box.y}));
  }

  /// Checks that parked vehicles are beside the lanes and do not overlap with other objects.
  void check_parked() const {
    if (site_.parked.empty()) return;
    Obstacles solid = solids();
    for (const ParkedVehicle& vehicle : site_.parked) {
      const Box3d& box = vehicle.state.box;
      if (stands_on_lane(box)) fail_on_lane(vehicle);
      if (solid.meet(box))
        config::fail((*site_.scene.parked)[vehicle.row].place, "offset_m",
                     "expected free ground, got " + described(vehicle.state) +
                         " that overlaps another object near " + at_text({box.x, box.y}));
      solid.add(box);
    }
  }

  /// Checks that pedestrians and cyclists are beside the traffic lanes, and that they do not
  /// overlap with objects or other rows of pedestrians and cyclists.
  void check_people() const {
    const SceneConfig& scene = site_.scene;
    if (!scene.people && !scene.standing_people) return;
    Obstacles solid = solids();
    for (const ParkedVehicle& vehicle : site_.parked) solid.add(vehicle.state.box);
    for (const PeopleConfig& row : scene.people.value_or(std::vector<PeopleConfig>{})) {
      const std::vector<Box3d> way = free_way(row);
      for (const Box3d& box : way) {
        if (scene.traffic) check_beside_lanes(box, row.place, "offset_m", "people");
        if (solid.meet(box))
          config::fail(
              row.place, "offset_m",
              "expected " + number_text(kPeopleBeside_m) +
                  " m of free ground on both sides of the line, got an object in the way near " +
                  at_text({box.x, box.y}));
      }
      for (const Box3d& box : way) solid.add(box);
    }
    for (const StandingPeopleConfig& group :
         scene.standing_people.value_or(std::vector<StandingPeopleConfig>{})) {
      const double side = 2 * radius_of(group);
      const Box3d box{group.x_m,       group.y_m, group.base_m + kPeopleHeight_m / 2, side, side,
                      kPeopleHeight_m, 0};
      if (scene.traffic) check_beside_lanes(box, group.place, "x_m", "standing people");
      if (solid.meet(box))
        config::fail(group.place, "x_m",
                     "expected free ground within " + number_text(radius_of(group)) +
                         " m of the group's centre, got another object there");
      solid.add(box);
    }
  }

  /// Returns the free space that a row of pedestrians or cyclists needs, in pieces of 2 m.
  std::vector<Box3d> free_way(const PeopleConfig& row) const {
    const Road road = road_named(site_.scene, site_.centrelines, row.road, row.place);
    const Curve line = line_beside(road.centreline, row);
    const double z = road.config.elevation_m;
    std::vector<Box3d> boxes;
    for (double s = 0; s < line.length(); s += kPeopleStep_m) {
      const double length = std::min(kPeopleStep_m, line.length() - s);
      const CurvePoint p = line.at(s + length / 2);
      boxes.push_back({p.position.x, p.position.y, z + kPeopleHeight_m / 2, length,
                       2 * kPeopleBeside_m, kPeopleHeight_m, p.heading});
    }
    return boxes;
  }

  const Site& site_;
  StripIndex lanes_;  ///< lanes of the network
  StripIndex paths_;  ///< lanes of the lane file
};

}  // namespace

void check_obstacles(const Site& site) { ObstacleRules(site).check(); }

}  // namespace infrasim
