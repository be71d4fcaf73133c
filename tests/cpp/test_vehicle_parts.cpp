#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <vector>

#include "infrasim/pipeline/simulate.h"
#include "infrasim/pipeline/static_units.h"
#include "infrasim/raycast/raycaster.h"
#include "infrasim/scene/vehicle_body.h"
#include "infrasim/sensor/vehicle_parts.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::empty_road;
using testing::plain_lidar;
using testing::point;
using testing::spinning;
using testing::straight_on;

constexpr VehicleParts kAll{true, true, true, true, true};
constexpr VehicleParts kNone{false, false, false, false, false};
constexpr VehicleParts only(bool VehicleParts::* part) {
  VehicleParts parts = kNone;
  parts.*part = true;
  return parts;
}

constexpr Vec3 kFront{1, 0, 0}, kLeft{0, 1, 0}, kUp{0, 0, 1};

/// Returns a hit on a car of 4.5 x 1.9 x 1.5 m: x metres ahead of the car's centre, y metres to the
/// left of the centre, and z metres above the road.
BodyHit car_hit(double x, double y, double z, Vec3 normal) {
  return {Class::kCar, {4.5, 1.9, 1.5}, {x / 4.5, y / 1.9, z / 1.5 - 0.5}, normal};
}

// --- where the parts are ------------------------------------------------------------------------

TEST(part, of_a_car_is_that_of_its_place) {
  EXPECT_EQ(part_at(car_hit(2.2, 0, 0.6, kFront), kAll), Part::kPaint);  // bumper
  EXPECT_EQ(part_at(car_hit(2.2, 0.1, 0.45, kFront), kAll), Part::kPlate);
  EXPECT_EQ(part_at(car_hit(2.2, 0.7, 0.6, kFront), kAll), Part::kLamp);
  EXPECT_EQ(part_at(car_hit(-2.2, 0.75, 0.8, kFront), kAll), Part::kLamp);
  EXPECT_EQ(part_at(car_hit(0.3, 0.9, 0.7, kLeft), kAll), Part::kPaint);  // door
  // window of the door
  EXPECT_EQ(part_at(car_hit(0.2, 0.9, 1.1, kLeft), kAll), Part::kGlass);
  EXPECT_EQ(part_at(car_hit(0.5, 0, 1.2, {.57, 0, .82}), kAll), Part::kGlass);  // windscreen
  EXPECT_EQ(part_at(car_hit(1.5, 0, 0.9, kUp), kAll), Part::kPaint);            // bonnet
  EXPECT_EQ(part_at(car_hit(0, 0, 1.5, kUp), kAll), Part::kPaint);              // roof
  EXPECT_EQ(part_at(car_hit(1.305, 0.95, 0.05, kLeft), kAll), Part::kTyre);
  EXPECT_EQ(part_at(car_hit(1.305, 0.95, 0.32, kLeft), kAll), Part::kPaint);  // rim
  EXPECT_EQ(part_at(car_hit(0, 0.95, 0.19, kLeft), kAll), Part::kGap);
  EXPECT_EQ(part_at(car_hit(0, 0.95, 0.21, kLeft), kAll), Part::kPaint);  // sill
}

/// Returns the hit of a ray from the sensor through `target` on a body with the box `box`.
std::optional<BodyHit> hit_at(Raycaster& raycaster, Class object_class, const Box3d& box,
                              Vec3 target) {
  RayBatch rays;
  rays.resize(1);
  rays.max_range = 1000;
  const Vec3 d = 1 / norm(target) * target;
  rays.dx[0] = static_cast<float>(d.x);
  rays.dy[0] = static_cast<float>(d.y);
  rays.dz[0] = static_cast<float>(d.z);
  HitBatch hits;
  raycaster.cast(rays, std::array{0U}, hits);
  if (hits.object[0] < 0) return std::nullopt;
  const auto& [at, normal] = hits.place[0];
  return BodyHit{object_class,
                 {box.dx, box.dy, box.dz},
                 {at[0], at[1], at[2]},
                 {normal[0], normal[1], normal[2]}};
}

// Rounding errors of a hit are about 1e-6 of the body's size. Windows of vans and buses end at the
// front and rear faces, on which hits lie only up to rounding.
TEST(part, of_a_hit_does_not_depend_on_rounding_errors) {
  constexpr double kRounding = 4e-6;
  std::vector<TriangleMesh> bodies;
  for (const ObjectClass& row : kObjectClasses)
    bodies.push_back(build_vehicle_body(row.id, Detail::kLow));
  const MeshLibrary library({}, bodies);
  Raycaster raycaster(library);
  const Rng rng(7);
  for (const Class c : {Class::kCar, Class::kVan, Class::kTruck, Class::kBus}) {
    int hits = 0, doubtful = 0;
    for (unsigned i = 0; i < 4000; ++i) {
      const Rng ray = rng.at(i);
      const Box3d box{20 + 20 * ray.uniform(0), -4 + 8 * ray.uniform(1), -3, 6, 2, 2.5,
                      2 * kPi * ray.uniform(2)};
      const MovingBody body{static_cast<int>(body_index(c)), box, box};
      raycaster.set_bodies(std::array{body}, 0.1);
      const Vec3 target =
          BoxFrame(box).from_box({box.dx * (ray.uniform(3) - 0.5), box.dy * (ray.uniform(4) - 0.5),
                                  box.dz * (ray.uniform(5) - 0.5)});
      const auto hit = hit_at(raycaster, c, box, target);
      if (!hit) continue;
      ++hits;
      const Part part = part_at(*hit, kAll);
      const auto moved = [&](Vec3 by) {
        BodyHit other = *hit;
        other.at = other.at + kRounding * by;
        return part_at(other, kAll);
      };
      for (const double side : {1.0, -1.0})
        if (moved({side, 0, 0}) != part || moved({0, side, 0}) != part ||
            moved({0, 0, side}) != part) {
          ++doubtful;
          break;
        }
    }
    EXPECT_GT(hits, 3000);
    EXPECT_LE(doubtful, hits / 500) << class_of(c).name;
  }
}

TEST(part, that_is_not_asked_for_is_paint) {
  EXPECT_FALSE(kNone.any());
  EXPECT_EQ(part_at(car_hit(0.2, 0.9, 1.1, kLeft), kNone), Part::kPaint);
  EXPECT_EQ(part_at(car_hit(0, 0.95, 0.1, kLeft), kNone), Part::kPaint);
  EXPECT_EQ(part_at(car_hit(2.2, 0.1, 0.45, kFront), kNone), Part::kPaint);
  constexpr VehicleParts gap = only(&VehicleParts::gap);
  EXPECT_EQ(part_at(car_hit(1.305, 0.95, 0.05, kLeft), gap), Part::kPaint);  // a wheel, no gap
  EXPECT_EQ(part_at(car_hit(0, 0.95, 0.1, kLeft), gap), Part::kGap);
}

TEST(part, of_riders_and_pedestrians_is_one) {
  for (const Class c : {Class::kMotorcycle, Class::kPedestrian, Class::kCyclist})
    for (const double z : {-0.49, 0.0, 0.3})
      EXPECT_EQ(part_at({c, {2, .8, 1.6}, {0, .5, z}, kLeft}, kAll), Part::kPaint);
}

/// Returns the share of glass in the area of a body's surface between two heights. The roof does
/// not count.
double glass_share(Class object_class, Vec3 size_m, double from, double to) {
  const TriangleMesh mesh = build_vehicle_body(object_class, Detail::kLow);
  double glass = 0, all = 0;
  for (const auto& t : mesh.triangles) {
    const auto vertex = [&](std::size_t i) {
      const auto& v = mesh.vertices.at(t.at(i));
      return Vec3{v[0], v[1], v[2]};
    };
    const Vec3 a = vertex(0), b = vertex(1) - a, c = vertex(2) - a;
    const auto scaled = [&](Vec3 v) {
      return Vec3{v.x * size_m.x, v.y * size_m.y, v.z * size_m.z};
    };
    const Vec3 across = cross(scaled(b), scaled(c));
    const double area = norm(across);
    if (area < 1e-9) continue;
    const Vec3 normal = 1 / area * across;
    for (int i = 0; i < 40; ++i)
      for (int j = 0; j + i < 40; ++j) {
        const Vec3 at = a + (i + 0.33) / 40 * b + (j + 0.33) / 40 * c;
        if (at.z + 0.5 < from || at.z + 0.5 > to || std::abs(normal.z) > 0.95) continue;
        all += area;
        if (part_at({object_class, size_m, at, normal}, kAll) == Part::kGlass) glass += area;
      }
  }
  return glass / all;
}

TEST(part, some_seven_tenths_above_the_belt_line_are_glass) {
  EXPECT_NEAR(glass_share(Class::kCar, {4.53, 1.95, 1.57}, .58, 1), 0.7, 0.1);
  EXPECT_NEAR(glass_share(Class::kVan, {5.3, 2.05, 2.25}, .50, 1), 0.7, 0.1);
  EXPECT_NEAR(glass_share(Class::kBus, {10.5, 2.94, 3.47}, .50, 1), 0.6, 0.1);
  EXPECT_LT(glass_share(Class::kTruck, {6.97, 2.7, 2.96}, .50, 1), 0.3);  // glass of the cab only
}

// --- how they send light back -------------------------------------------------------------------

double sent_back(Part part, double cosine, const VehicleParts& parts = kAll) {
  const Optics o = optics_of(part, Class::kCar, 0.5F, cosine, parts);
  return static_cast<double>(o.reflectance) * o.gain;
}

TEST(optics, of_paint_without_a_coat_are_those_of_lambert) {
  EXPECT_NEAR(sent_back(Part::kPaint, 0.6, kNone), 0.3, 1e-6);
}

TEST(optics, of_clear_coat_lose_what_fresnel_says_on_both_ways) {
  // R(n = 1.5) is 4.00 % at normal incidence, 8.92 % at 60 degrees and 25.3 % at 75 degrees.
  EXPECT_NEAR(sent_back(Part::kPaint, 1), 0.5, 1e-6);
  EXPECT_NEAR(sent_back(Part::kPaint, 0.5), 0.25 * std::pow(.9108 / .96, 2), 1e-4);
  const double c = std::cos(rad(75));
  EXPECT_NEAR(sent_back(Part::kPaint, c), 0.5 * c * std::pow(.7470 / .96, 2), 1e-3);
}

TEST(optics, of_glass_are_almost_nothing_but_head_on) {
  EXPECT_GT(sent_back(Part::kGlass, std::cos(rad(2))), 1);
  EXPECT_LT(sent_back(Part::kGlass, std::cos(rad(4))), 0.01);
}

TEST(optics, of_plates_and_lamps_are_brighter_than_white_at_any_angle) {
  EXPECT_GT(sent_back(Part::kPlate, 0.3), 2);
  EXPECT_GT(sent_back(Part::kLamp, 0.3), 1);
}

// --- what rays do -------------------------------------------------------------------------------

/// The points of one frame. `points` is the number of points by id of the vehicle on which they
/// lie; -1 for the road.
struct Seen {
  std::map<int, int> points;
  double lowest_m = kInf;         ///< lowest point of a vehicle above the road
  std::vector<Vec3> of_vehicles;  ///< levelled frame
};

/// Returns the points of vehicles in front of a sensor that detects by received power. The sensor
/// is 6 m above the road.
Seen seen(const std::vector<ObjectState>& vehicles, const VehicleParts& parts,
          double range_at_10_percent_m = 100, bool by_power = true) {
  SceneConfig scene = empty_road();
  scene.detail = Detail::kLow;
  scene.vehicle_parts = parts;
  LidarConfig lidar = plain_lidar("lidar", spinning(161, -40, 0, 0.1));
  if (by_power)
    lidar.units.front().returns.detection.emplace().range_at_10_percent_m = range_at_10_percent_m;
  World world = build_world(scene);
  world.trajectories = std::make_shared<const Trajectories>(straight_on(vehicles, 10));
  FrameSimulator simulator(world, std::array{lidar});
  const Frame frame = std::move(simulator.simulate(0, {true}).front());
  Seen out;
  for (std::size_t i = 0; i < frame.cloud.size(); ++i) {
    ++out.points[frame.cloud.object_id[i]];
    if (frame.cloud.object_id[i] < 0) continue;
    out.of_vehicles.push_back(point(frame.cloud, i));
    out.lowest_m = std::min(out.lowest_m, out.of_vehicles.back().z + 6);
  }
  return out;
}

/// Returns a car with silver or white paint. The paint depends on the id.
ObjectState car(int id, double x, double y = 0, double heading = kPi / 2) {
  return testing::car_on_road(id, x, y, heading);
}

TEST(parts, leave_presets_without_detection_alone) {
  const std::vector cars{car(1, 20)};
  EXPECT_EQ(seen(cars, kAll, 100, false).points, seen(cars, kNone, 100, false).points);
}

TEST(parts, gap_lets_rays_pass_on_to_the_road) {
  const Seen without = seen({car(1, 20)}, kNone),
             with = seen({car(1, 20)}, only(&VehicleParts::gap));
  EXPECT_LT(without.lowest_m, 0.1);
  const int lost = without.points.at(1) - with.points.at(1);
  EXPECT_GT(lost, 50);
  // All rays meet the road or the wheels on the far side.
  EXPECT_EQ(with.points.at(-1) - without.points.at(-1), lost);
}

/// Returns a scene with a parked car, 20 m beside the road and the sensor, on terrain 5 cm below
/// the road.
SceneConfig car_on_terrain() {
  SceneConfig scene = empty_road();
  scene.detail = Detail::kLow;
  scene.vehicle_parts = only(&VehicleParts::gap);
  scene.ground.push_back(testing::ground_at(-0.05));
  ParkedConfig row;
  row.road = "road";
  row.offset_m = 20;
  row.from_m = 197;
  row.to_m = 203;
  row.occupied = 1;
  row.base_m = -0.05;
  row.class_shares["Car"] = 1;
  scene.parked.emplace().push_back(row);
  return scene;
}

/// Returns a LiDAR that detects by power and has a repeating pattern.
LidarConfig by_power() {
  PatternConfig pattern = spinning(161, -40, 0, 0.1);
  pattern.spinning->azimuth_step_deg.reset();
  pattern.spinning->columns_per_turn = Fraction{3600, 1};
  LidarConfig lidar = plain_lidar("lidar", pattern);
  lidar.units.front().returns.detection.emplace().range_at_10_percent_m = 100;
  return lidar;
}

/// Returns the number of points, by class, on the ground below the only vehicle, which is parked.
std::map<Class, int> below_parked(const World& world, const LidarConfig& lidar,
                                  const StaticLayers& layers) {
  FrameSimulator simulator(world, std::array{lidar}, layers);
  const Frame frame = std::move(simulator.simulate(0, {true}).front());
  const Box3d box = world.level.to_level(world.trajectories->between(0, 1).front().from);
  Box3d foot = box;
  foot.z -= box.dz / 2;
  foot.dz = 0.2;
  std::map<Class, int> out;
  for (std::size_t i = 0; i < frame.cloud.size(); ++i)
    if (frame.cloud.object_id[i] < 0 && BoxFrame(foot).contains(point(frame.cloud, i), 0))
      ++out[static_cast<Class>(frame.cloud.class_id[i])];
  return out;
}

TEST(parts, gap_shows_the_ground_that_a_parked_vehicle_stands_on) {
  const World world = build_world(car_on_terrain());
  const LidarConfig lidar = by_power();
  LidarConfig wide = lidar;
  wide.units.front().returns.beam.emplace();
  const StaticLayers layers = make_static_layers(world, std::array{lidar});
  ASSERT_NE(layers[0][0], nullptr);
  for (const auto& below : {below_parked(world, lidar, layers), below_parked(world, lidar, {}),
                            below_parked(world, wide, {})}) {
    EXPECT_EQ(below.size(), 1U);
    EXPECT_GT(below.at(Class::kTerrain), 100);
  }
}

TEST(parts, gap_shows_the_ground_that_a_recorded_vehicle_drives_on) {
  SceneConfig scene = car_on_terrain();
  World world = build_world(scene);
  world.scene.traffic.reset();
  ObjectState recorded = car(1, 0, 20, 0);
  recorded.box.z -= 0.05;
  world.trajectories = std::make_shared<const Trajectories>(straight_on({recorded}, 1));
  EXPECT_GT(below_parked(world, by_power(), {}).at(Class::kTerrain), 100);
}

TEST(parts, gap_shows_what_a_recording_of_the_site_saw_of_the_ground_there) {
  World world = build_world(car_on_terrain());
  const LidarConfig lidar = by_power();
  StaticLayerFile recorded;
  recorded.units = cast_static_layer(world, lidar);
  for (StaticHits& unit : recorded.units) {
    std::ranges::fill(unit.class_id, static_cast<std::uint16_t>(Class::kRecorded));
    std::ranges::fill(unit.gain, 0.3F);
  }
  world.static_layers.emplace(lidar.name, recorded);
  FrameSimulator simulator(world, std::array{lidar});
  const Frame frame = std::move(simulator.simulate(0, {true}).front());
  for (std::size_t i = 0; i < frame.cloud.size(); ++i) {
    if (frame.cloud.object_id[i] >= 0) continue;
    EXPECT_EQ(frame.cloud.class_id[i], static_cast<std::uint16_t>(Class::kRecorded));
    EXPECT_EQ(frame.cloud.intensity[i], 0.3F);
  }
}

TEST(parts, glass_takes_most_of_the_points_above_the_belt_line) {
  const auto above_belt = [](const Seen& s) {
    return std::ranges::count_if(s.of_vehicles,
                                 [](Vec3 p) { return p.z + 6 > 0.6 * 1.5 && p.z + 6 < 1.4; });
  };
  const auto without = above_belt(seen({car(1, 45)}, kNone));
  const auto with = above_belt(seen({car(1, 45)}, only(&VehicleParts::glass)));
  EXPECT_GT(without, 50);
  EXPECT_LT(static_cast<double>(with) / static_cast<double>(without), 0.6);
  EXPECT_GT(with, 0);
}

TEST(parts, glass_shows_what_stands_behind_it) {
  // Seen from nearby, rays hit the floor and the far side of the cabin, which are inside the box.
  const Seen s = seen({car(1, 8)}, only(&VehicleParts::glass), 400);
  int inside = 0;
  for (const Vec3& p : s.of_vehicles) {
    EXPECT_GT(p.z + 6, 0) << "a point below the road";
    EXPECT_LT(std::abs(p.x - 8), 0.95 + 1e-3);
    EXPECT_LT(std::abs(p.y), 2.25 + 1e-3);
    inside += std::abs(p.z + 6 - kSillHeight_m) < 1e-3 && std::abs(p.x - 8) < 0.8;
  }
  EXPECT_GT(inside, 10);  // points on the floor of the cabin
}

TEST(parts, glass_in_the_blind_zone_does_not_hide_what_stands_behind_it) {
  SceneConfig scene = empty_road();
  scene.mounts["pole"].z_m = 1.15;
  scene.vehicle_parts = only(&VehicleParts::glass);
  World world = build_world(scene);
  world.trajectories = std::make_shared<const Trajectories>(
      straight_on({car(1, 8)}, 10));  // rays meet its side windows at normal incidence
  const auto points = [&](double min_range_m) {
    LidarConfig lidar = plain_lidar("lidar", spinning(5, -0.5, 0.5, 0.1));
    lidar.units.front().returns.min_range_m = min_range_m;
    lidar.units.front().returns.detection.emplace().range_at_10_percent_m = 400;
    const Frame f = std::move(FrameSimulator(world, std::array{lidar}).simulate(0, {true}).front());
    int glints = 0, inside = 0;
    for (std::size_t i = 0; i < f.cloud.size(); ++i)
      if (const Vec3 p = point(f.cloud, i); std::abs(p.y) < 0.01 * p.x)
        (p.x < 7.5 ? glints : inside) += 1;
    return std::pair{glints, inside};
  };
  const auto [glints, hidden] = points(0);
  EXPECT_GT(glints, 10);
  EXPECT_EQ(hidden, 0);
  EXPECT_EQ(points(7.5), std::pair(0, glints));
}

TEST(parts, reflectors_are_seen_where_paint_is_not) {
  const std::vector cars{car(1, 60, 0, kPi)};  // its front faces the sensor
  const Seen dim = seen(cars, kNone, 15), bright = seen(cars, only(&VehicleParts::reflectors), 15);
  EXPECT_EQ(dim.points.count(1), 0U);
  EXPECT_GT(bright.points.at(1), 3);
}

TEST(parts, move_with_the_vehicle) {
  // The same car twice: standing at its position at mid-frame, and driving past.
  const auto run = [](double speed) {
    ObjectState moving = car(1, -20, -speed * 0.05);
    moving.speed_m_s = speed;
    return seen({moving}, kAll).points.at(1);
  };
  EXPECT_NEAR(static_cast<double>(run(20)) / run(0), 1, 0.1);
}

}  // namespace
}  // namespace infrasim
