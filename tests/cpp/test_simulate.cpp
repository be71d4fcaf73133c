#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <map>
#include <mutex>
#include <numeric>
#include <random>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "infrasim/pipeline/run.h"
#include "infrasim/pipeline/scheduler.h"
#include "infrasim/pipeline/simulate.h"
#include "infrasim/pipeline/summary.h"
#include "infrasim/pipeline/vehicles.h"
#include "infrasim/scene/vehicle_body.h"
#include "infrasim/sensor/beam.h"
#include "infrasim/sensor/echo_merge.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::car_on_road;
using testing::distance_to_surface;
using testing::empty_road;
using testing::expect_equal;
using testing::frame_of;
using testing::ground_at;
using testing::plain_lidar;
using testing::point;
using testing::spinning;
using testing::straight_on;
using testing::world_with;

/// Returns a LiDAR that looks 0 to 20 degrees down, with enough rays to hit a car often.
LidarConfig fine_lidar(const std::string& name = "lidar") {
  return plain_lidar(name, spinning(41, -20, 0, 0.5));
}

LidarConfig drawing_lidar(const std::string& name) {
  LidarConfig lidar = fine_lidar(name);
  lidar.units.front().pattern.spinning->phase = MotorPhase::kFree;
  lidar.units.front().returns.range_accuracy_m = 0.03;
  lidar.units.front().returns.drop_off.emplace();
  return lidar;
}

/// Returns cars and a bus around the mount, in the world frame.
std::vector<ObjectState> vehicles_around() {
  ObjectState bus = car_on_road(4, -30, 5.3, kPi, 12);
  bus.object_class = Class::kBus;
  bus.box.dx = 11;
  bus.box.dz = 3.4;
  bus.box.z = 1.7;
  return {car_on_road(1, 12, -1.8, 0, 20), car_on_road(2, 25, -1.8, 0, 20),
          car_on_road(3, 18, 1.8, kPi, 15), bus, car_on_road(7, 60, -1.8, 0.1, 0)};
}

// --- where points lie -------------------------------------------------------------------------

TEST(frame, range_to_flat_ground_is_height_over_sine) {
  SceneConfig scene = empty_road();
  scene.ground.push_back(ground_at(-0.5));
  const Frame f = frame_of(world_with(scene, {}), fine_lidar());
  std::size_t on_road = 0;
  for (std::size_t i = 0; i < f.cloud.size(); ++i) {
    const bool road = f.cloud.class_id[i] == static_cast<std::uint16_t>(Class::kRoad);
    const double depression = rad(20 - 0.5 * f.cloud.ring[i]);
    EXPECT_NEAR(norm(point(f.cloud, i)), (road ? 6 : 6.5) / std::sin(depression), 1e-3);
    on_road += road;
  }
  EXPECT_GT(on_road, 1000U);
  EXPECT_GT(f.cloud.size() - on_road, 1000U);
  EXPECT_EQ(f.rays, 41U * 720U);
}

TEST(frame, points_of_a_standing_vehicle_lie_on_its_box) {
  SceneConfig scene = empty_road();
  scene.mounts["pole"] = {.x_m = 3, .y_m = -7, .z_m = 5, .yaw_deg = 30};
  const std::vector standing{car_on_road(5, 20, -1.8, 0.2), car_on_road(6, 2, 1.8, kPi)};
  const Frame f = frame_of(world_with(scene, standing), fine_lidar());
  ASSERT_EQ(f.objects.size(), 2U);
  std::map<int, int> points;
  for (std::size_t i = 0; i < f.cloud.size(); ++i) {
    if (f.cloud.object_id[i] < 0) continue;
    const ObjectRecord& o = f.objects[f.cloud.object_id[i] == 6];
    EXPECT_LT(distance_to_surface(o.box, point(f.cloud, i)), 1e-3);
    EXPECT_EQ(f.cloud.class_id[i], static_cast<std::uint16_t>(Class::kCar));
    ++points[f.cloud.object_id[i]];
  }
  for (const ObjectRecord& o : f.objects) {
    EXPECT_GT(o.points, 30);
    EXPECT_EQ(o.points, points[o.id]);
    EXPECT_EQ(o.points_in_box, o.points);
  }
}

TEST(frame, boxes_are_those_of_the_world_seen_from_the_mount) {
  SceneConfig scene = empty_road();
  scene.mounts["pole"] = {.x_m = 10, .y_m = 5, .z_m = 6, .yaw_deg = 90};
  const Frame f = frame_of(world_with(scene, {car_on_road(1, 10, 25, rad(120), 5)}), fine_lidar());
  const ObjectRecord& o = f.objects.at(0);
  EXPECT_NEAR(o.box.x, 20 + 0.25 * std::sin(rad(120)), 1e-9);  // mid-frame is 0.05 s later
  EXPECT_NEAR(o.box.y, -0.25 * std::cos(rad(120)), 1e-9);
  EXPECT_NEAR(o.box.z, 0.75 - 6, 1e-9);
  EXPECT_NEAR(o.box.heading, rad(30), 1e-9);
  EXPECT_NEAR(o.distance, std::hypot(o.box.x, o.box.y), 1e-9);
  EXPECT_EQ(o.speed_m_s, 5);
}

TEST(frame, without_vehicles_is_the_same_at_any_time) {
  const World world = world_with(empty_road(), {});
  expect_equal(frame_of(world, fine_lidar(), 0).cloud, frame_of(world, fine_lidar(), 9).cloud);
}

TEST(frame, that_the_scene_does_not_have_is_an_error) {
  const World world = world_with(empty_road(), {});
  for (const int k : {-1, 10}) testing::error_of([&] { frame_of(world, fine_lidar(), k); });
}

// --- motion -----------------------------------------------------------------------------------

/// Returns the box of a vehicle at the firing time of a point.
Box3d box_at(const World& world, const PointCloud& cloud, std::size_t i, int k) {
  for (const MovingObject& o : world.trajectories->between(k, k + 1))
    if (o.id == cloud.object_id[i])
      return world.level.to_level(o.at(cloud.time[i] / kUsualPeriod_s));
  ADD_FAILURE() << "no vehicle " << cloud.object_id[i];
  return {};
}

TEST(exact_aggregation, points_lie_on_the_vehicle_where_it_is_when_they_are_measured) {
  const World world = world_with(empty_road(), vehicles_around());
  const Frame f = frame_of(world, fine_lidar(), 3);
  int checked = 0;
  for (std::size_t i = 0; i < f.cloud.size(); ++i) {
    if (f.cloud.object_id[i] < 0) continue;
    EXPECT_LT(distance_to_surface(box_at(world, f.cloud, i, 3), point(f.cloud, i)), 1e-3);
    ++checked;
  }
  EXPECT_GT(checked, 300);
}

World sliced(const char* aggregation) {
  SceneConfig scene = empty_road();
  scene.aggregation = parse_aggregation(aggregation).value();
  return world_with(scene, vehicles_around());
}

TEST(slices, of_1_ms_put_points_within_1_ms_of_motion_of_the_exact_ones) {
  const World world = sliced("exact");
  const Frame exact = frame_of(world, fine_lidar(), 3);
  const Frame approximate = frame_of(sliced("slices:100"), fine_lidar(), 3);
  std::map<std::pair<int, float>, std::size_t> exact_of_ray;
  for (std::size_t i = 0; i < exact.cloud.size(); ++i)
    exact_of_ray[{exact.cloud.ring[i], exact.cloud.time[i]}] = i;
  int compared = 0, all = 0;
  for (std::size_t i = 0; i < approximate.cloud.size(); ++i) {
    const int id = approximate.cloud.object_id[i];
    if (id < 0) continue;
    ++all;
    const Vec3 p = point(approximate.cloud, i);
    EXPECT_LT(distance_to_surface(box_at(world, approximate.cloud, i, 3), p), 20 * 0.001 + 1e-3);
    const auto same = exact_of_ray.find({approximate.cloud.ring[i], approximate.cloud.time[i]});
    if (same == exact_of_ray.end() || exact.cloud.object_id[same->second] != id) continue;
    ++compared;
    // The cars ahead drive along the view, so a point moves at most as far as its car.
    const bool ahead = id == 2 || id == 7;
    EXPECT_TRUE(!ahead || norm(point(exact.cloud, same->second) - p) < 20 * 0.001 + 1e-3);
  }
  EXPECT_GT(all, 300);
  EXPECT_GT(compared, 0.98 * all);  // the other points are at an outline
}

TEST(slices, come_in_firing_order_with_every_ray_of_the_frame) {
  const Frame exact = frame_of(sliced("exact"), fine_lidar(), 3);
  const Frame approximate = frame_of(sliced("slices:7"), fine_lidar(), 3);
  EXPECT_EQ(exact.rays, approximate.rays);
  EXPECT_TRUE(std::ranges::is_sorted(approximate.cloud.time));
  EXPECT_NEAR(static_cast<double>(approximate.cloud.size()),
              static_cast<double>(exact.cloud.size()),
              0.005 * static_cast<double>(exact.cloud.size()));
}

TEST(instant, puts_all_points_of_a_vehicle_into_its_box) {
  const Frame f = frame_of(sliced("instant"), fine_lidar(), 3);
  int points = 0;
  for (const ObjectRecord& o : f.objects) {
    EXPECT_EQ(o.points, o.points_in_box) << o.id;
    points += o.points;
  }
  EXPECT_GT(points, 300);
}

TEST(exact_aggregation, leaves_points_of_a_moving_vehicle_outside_its_box) {
  const Frame f = frame_of(sliced("exact"), fine_lidar(), 3);
  int outside = 0;
  for (const ObjectRecord& o : f.objects) {
    EXPECT_TRUE(o.speed_m_s > 0 || o.points == o.points_in_box);
    outside += o.points - o.points_in_box;
  }
  EXPECT_GT(outside, 10);
}

TEST(aggregation, of_a_world_that_stands_still_makes_no_difference) {
  std::vector<ObjectState> standing = vehicles_around();
  for (ObjectState& s : standing) s.speed_m_s = 0;
  SceneConfig scene = empty_road();
  const Frame exact = frame_of(world_with(scene, standing), fine_lidar(), 2);
  scene.aggregation = parse_aggregation("slices:10").value();
  expect_equal(frame_of(world_with(scene, standing), fine_lidar(), 2).cloud, exact.cloud);
}

// --- repeatable -------------------------------------------------------------------------------

TEST(frame, of_a_lidar_does_not_depend_on_the_other_lidars) {
  const World world = world_with(empty_road(), vehicles_around());
  LidarConfig far = drawing_lidar("far");
  far.units.front().returns.max_range_m = 300;
  LidarConfig near = drawing_lidar("near");
  near.units.front().returns.max_range_m = 50;
  const std::array lidars{far, drawing_lidar("a"), near, drawing_lidar("b")};
  FrameSimulator together(world, lidars);
  const auto frames = together.simulate(4, {true, true, true, true});
  for (std::size_t i = 0; i < lidars.size(); ++i) {
    SCOPED_TRACE(lidars.at(i).name);
    const Frame alone = frame_of(world, lidars.at(i), 4);
    expect_equal(frames[i].cloud, alone.cloud);
    ASSERT_EQ(frames[i].objects.size(), alone.objects.size());
    for (std::size_t n = 0; n < alone.objects.size(); ++n) {
      EXPECT_EQ(frames[i].objects[n].points, alone.objects[n].points);
      EXPECT_EQ(frames[i].objects[n].visibility, alone.objects[n].visibility);
    }
  }
  EXPECT_FALSE(frames[1].cloud.xyz == frames[3].cloud.xyz);
}

TEST(frame, of_a_lidar_does_not_depend_on_another_that_sees_a_vehicle_come_into_reach) {
  // The car is beyond the 50 m of the first LiDAR at mid-frame, and within them at the end of the
  // frame.
  SceneConfig scene = empty_road();
  scene.mounts["pole"].z_m = 1;
  const World world = world_with(scene, {car_on_road(1, 50 + 2.25 + 1.6, 0, kPi, 30)}, 1);
  LidarConfig near = plain_lidar("near", spinning(11, -0.5, 0.5, 0.1));
  near.units.front().returns.max_range_m = 50;
  near.units.front().yaw_deg = -20;  // the LiDAR looks along x at the end of its turn
  LidarConfig far = near;
  far.name = "far";
  far.units.front().returns.max_range_m = 200;
  FrameSimulator together(world, std::array{near, far});
  const Frame beside = std::move(together.simulate(0, {true, true}).front());
  const Frame alone = frame_of(world, near);
  expect_equal(beside.cloud, alone.cloud);
  EXPECT_GT(std::ranges::count(alone.cloud.object_id, 1), 5);
  for (const Frame* f : {&beside, &alone})
    for (const int id : f->cloud.object_id)
      EXPECT_TRUE(id < 0 || std::ranges::count(f->objects, id, &ObjectRecord::id) == 1)
          << "a point on a vehicle that is not in the list";
}

TEST(frame, does_not_depend_on_the_frames_before_it) {
  SceneConfig scene = empty_road();
  scene.duration_s = 5;
  scene.traffic->vehicles_per_km_lane = 20;
  const World world = build_world(scene);
  FrameSimulator one_by_one(world, std::array{drawing_lidar("a")});
  for (int k = 40; k < 45; ++k) one_by_one.simulate(k, {true});
  const Frame after = std::move(one_by_one.simulate(45, {true}).front());
  const Frame alone = frame_of(world, drawing_lidar("a"), 45);
  expect_equal(after.cloud, alone.cloud);
  EXPECT_GT(alone.objects.size(), 3U);
}

TEST(frame, that_is_not_wanted_stays_empty) {
  const World world = world_with(empty_road(), vehicles_around());
  FrameSimulator simulator(world, std::array{fine_lidar("a"), fine_lidar("b")});
  const auto frames = simulator.simulate(0, {false, true});
  EXPECT_EQ(frames[0].cloud.size(), 0U);
  EXPECT_EQ(frames[0].rays, frames[1].rays);
  EXPECT_GT(frames[1].cloud.size(), 0U);
}

TEST(frame, of_another_seed_draws_other_returns) {
  SceneConfig scene = empty_road();
  const Frame one = frame_of(world_with(scene, {}), drawing_lidar("a"));
  scene.seed = 2;
  EXPECT_NE(frame_of(world_with(scene, {}), drawing_lidar("a")).cloud.size(), one.cloud.size());
}

// --- visibility -------------------------------------------------------------------------------

TEST(frame, visibility_is_a_share_within_the_region_and_unknown_outside) {
  SceneConfig scene = empty_road();
  scene.region_half_length_m = 40;
  std::vector<ObjectState> vehicles = vehicles_around();  // the last vehicle is at 60 m
  vehicles.push_back(car_on_road(9, 20, 12, 0));          // beside the road
  const Frame f = frame_of(world_with(scene, vehicles), fine_lidar());
  ASSERT_EQ(f.objects.size(), 6U);
  for (const ObjectRecord& o : f.objects) {
    const bool outside = o.id == 4 || o.id == 7 || o.id == 9;  // the bus is also off the road
    if (outside)
      EXPECT_EQ(o.visibility, -1) << o.id;
    else
      EXPECT_TRUE(o.visibility >= 0 && o.visibility <= 1) << o.id << ": " << o.visibility;
  }
  EXPECT_EQ(f.objects[0].visibility, 1);
}

TEST(frame, every_vehicle_in_reach_is_listed_hit_or_not) {
  LidarConfig lidar = fine_lidar();
  lidar.units.front().returns.max_range_m = 40;
  std::vector<ObjectState> vehicles = vehicles_around();  // the last vehicle is at 60 m
  const Frame f = frame_of(world_with(empty_road(), vehicles), lidar);
  std::vector<int> ids;
  for (const ObjectRecord& o : f.objects) ids.push_back(o.id);
  EXPECT_EQ(ids, (std::vector<int>{1, 2, 3, 4}));
}

// --- bundles and mounts -----------------------------------------------------------------------

TEST(bundle, has_the_points_of_its_parts_and_rings_that_go_on) {
  const World world = world_with(empty_road(), vehicles_around());
  LidarConfig left = fine_lidar("left"), right = fine_lidar("right");
  left.units.front().yaw_deg = 30;
  right.units.front().yaw_deg = -40;
  right.units.front().pitch_deg = 5;
  LidarConfig both = left;
  both.name = "both";
  both.units.push_back(right.units.front());
  const Frame whole = frame_of(world, both, 2);
  PointCloud parts = frame_of(world, left, 2).cloud;
  const PointCloud second = frame_of(world, right, 2).cloud;
  const auto append = [](auto& to, const auto& from) {
    to.insert(to.end(), from.begin(), from.end());
  };
  append(parts.xyz, second.xyz);
  append(parts.intensity, second.intensity);
  append(parts.time, second.time);
  for (const int ring : second.ring) parts.ring.push_back(static_cast<std::uint16_t>(41 + ring));
  append(parts.class_id, second.class_id);
  append(parts.object_id, second.object_id);
  append(parts.echo, second.echo);
  expect_equal(whole.cloud, parts);
  EXPECT_EQ(whole.rays, 2U * 41U * 720U);
}

TEST(mount, that_leans_turns_the_beams_and_leaves_boxes_and_walls_upright) {
  SceneConfig scene = empty_road();
  BuildingConfig& wall = scene.buildings.emplace_back();
  wall.x_m = 40;
  wall.y_m = 20;
  wall.width_m = 30;
  wall.height_m = 20;
  const LidarConfig lidar = plain_lidar("lidar", spinning(1, 0, 0, 0.2));
  const Frame level = frame_of(world_with(scene, vehicles_around()), lidar);
  scene.mounts["pole"].pitch_deg = 10;
  scene.mounts["pole"].roll_deg = 4;
  const Frame leaning = frame_of(world_with(scene, vehicles_around()), lidar);

  ASSERT_EQ(leaning.objects.size(), level.objects.size());
  for (std::size_t i = 0; i < level.objects.size(); ++i) {
    const Box3d &a = leaning.objects[i].box, &b = level.objects[i].box;
    EXPECT_TRUE(a.x == b.x && a.y == b.y && a.z == b.z && a.heading == b.heading);
  }
  // All beams of the single line lie in a plane through the sensor, which is tilted like the mount.
  const Vec3 normal = rotation(0, rad(10), rad(4)) * Vec3{0, 0, 1};
  int on_wall = 0, on_road = 0;
  for (std::size_t i = 0; i < leaning.cloud.size(); ++i) {
    const Vec3 p = point(leaning.cloud, i);
    EXPECT_NEAR(dot(p, normal), 0, 1e-3);
    if (leaning.cloud.class_id[i] == static_cast<std::uint16_t>(Class::kStructure) && p.y > 5.01) {
      EXPECT_NEAR(p.x, 35, 1e-3);
      ++on_wall;
    } else if (leaning.cloud.class_id[i] == static_cast<std::uint16_t>(Class::kRoad)) {
      EXPECT_NEAR(p.z, -6, 1e-3);
      ++on_road;
    }
  }
  EXPECT_GT(on_wall, 20);
  EXPECT_GT(on_road, 20);
}

TEST(mount, pitched_down_looks_at_the_ground_ahead) {
  SceneConfig scene = empty_road();
  scene.mounts["pole"].pitch_deg = 10;
  const Frame f = frame_of(world_with(scene, {}), plain_lidar("lidar", spinning(1, 0, 0, 0.2)));
  double nearest = kInf;
  for (std::size_t i = 0; i < f.cloud.size(); ++i) {
    EXPECT_GT(f.cloud.xyz[3 * i], 0);
    nearest = std::min(nearest, norm(point(f.cloud, i)));
  }
  EXPECT_NEAR(nearest, 6 / std::sin(rad(10)), 1e-3);
}

// --- beams wider than a ray -------------------------------------------------------------------

/// Returns a scene whose road is 100 m away, so that objects can be anywhere around the mount.
SceneConfig open_site() {
  SceneConfig scene = empty_road();
  scene.roads.front().start.y_m = -100;
  return scene;
}

LidarConfig beam_lidar(double elevation_deg, double vertical_deg) {
  LidarConfig lidar = plain_lidar("lidar", spinning(1, elevation_deg, elevation_deg, 0.5));
  lidar.units.front().returns.detection.emplace().range_at_10_percent_m = 1000;
  lidar.units.front().returns.beam =
      BeamConfig{.vertical_deg = vertical_deg, .sub_rays = 9, .where = BeamWhere::kEverywhere};
  return lidar;
}

TEST(beam, on_a_wall_is_at_the_walls_range) {
  SceneConfig scene = empty_road();
  scene.buildings.emplace_back().x_m = 25;
  scene.buildings.back().y_m = 20;
  scene.buildings.back().width_m = 30;
  scene.buildings.back().height_m = 20;
  const Frame f = frame_of(world_with(scene, {}), beam_lidar(1, 0.3));
  ASSERT_GT(f.cloud.size(), 20U);
  for (std::size_t i = 0; i < f.cloud.size(); ++i) {
    const Vec3 p = point(f.cloud, i);
    // the front of the car, or a point near its corner
    EXPECT_TRUE(std::abs(p.x - 20) < 0.01 || p.y < 5.1) << p.x;
  }
}

TEST(beam, just_above_the_horizon_sees_what_stands_just_below_it) {
  SceneConfig scene = empty_road();
  BuildingConfig& wall = scene.buildings.emplace_back();
  wall.x_m = 25;
  wall.y_m = 20;
  wall.width_m = 30;
  // the top is 0.14 degrees below the horizon, seen from 20 m away at 6 m height
  wall.height_m = 5.95;
  const Frame f = frame_of(world_with(scene, {}), beam_lidar(0.2, 2));  // beam: -0.8 to 1.2 degrees
  EXPECT_GT(f.cloud.size(), 20U);
}

/// Returns the range that a beam of two equal sub-rays reports, from the hits of both.
float reported(const std::array<float, 2>& ranges, const std::array<float, 2>& reflectance,
               const EchoPath& path) {
  EchoBatch sub_echoes, echoes;
  sub_echoes.resize(2);
  echoes.resize(1);
  for (std::size_t i = 0; i < 2; ++i) sub_echoes.set(i, {ranges[i], -1, 0, reflectance[i], 1});
  std::vector<float> sunlit(1);
  constexpr std::array<SubRay, 2> kSubRays{{{0, 0.5F}, {0, 0.5F}}};
  EchoMerger(0.5, path).merge(kSubRays, sub_echoes, {}, std::array{0U},
                              std::array<std::uint16_t, 1>{}, echoes, sunlit, nullptr);
  return echoes.range[0];
}

TEST(beam, reports_the_strongest_echo_beyond_the_blind_zone) {
  EXPECT_FLOAT_EQ(reported({0.5F, 20}, {0.2F, 0.2F}, {}), 0.5F);
  EXPECT_FLOAT_EQ(reported({0.5F, 20}, {0.2F, 0.2F}, {.min_range_m = 1}), 20.0F);
  EXPECT_FLOAT_EQ(reported({20, 0.5F}, {0.2F, 0.2F}, {.min_range_m = 1}), 20.0F);
  EXPECT_TRUE(std::isinf(reported({0.5F, 0.7F}, {0.2F, 0.2F}, {.min_range_m = 1})));
}

TEST(beam, reports_the_echo_that_is_strongest_after_the_air) {
  // At twice the range, nine times the reflectance is stronger, unless the air on the longer way
  // absorbs more.
  EXPECT_FLOAT_EQ(reported({50, 100}, {0.1F, 0.9F}, {}), 100.0F);
  EXPECT_FLOAT_EQ(reported({50, 100}, {0.1F, 0.9F}, {.extinction_per_m = 0.001}), 100.0F);
  EXPECT_FLOAT_EQ(reported({50, 100}, {0.1F, 0.9F}, {.extinction_per_m = 0.01}), 50.0F);
}

TEST(beam, partly_in_the_blind_zone_sees_what_stands_beyond_it) {
  // A pole nearby fills a part of the beam. A wall far away fills the rest.
  SceneConfig scene = open_site();
  BuildingConfig& pole = scene.buildings.emplace_back();
  pole.length_m = pole.width_m = 0.2;
  pole.x_m = 3;
  BuildingConfig& wall = scene.buildings.emplace_back();
  wall.x_m = 25;
  wall.width_m = 40;
  LidarConfig lidar = beam_lidar(0, 0.1);
  lidar.units.front().returns.beam->horizontal_deg = 8;
  const auto behind_the_pole = [&](double min_range_m) {
    lidar.units.front().returns.min_range_m = min_range_m;
    const Frame f = frame_of(world_with(scene, {}), lidar);
    int points = 0;
    for (std::size_t i = 0; i < f.cloud.size(); ++i)
      points += point(f.cloud, i).x > 10 && std::abs(point(f.cloud, i).y) < 1;
    return points;
  };
  EXPECT_EQ(behind_the_pole(0), 0);
  EXPECT_GT(behind_the_pole(5), 8);
}

LidarConfig wide_beam_lidar(double elevation_deg, double pitch_deg = 0) {
  LidarConfig lidar = beam_lidar(elevation_deg, 0.1);
  lidar.units.front().pitch_deg = pitch_deg;
  lidar.units.front().returns.beam->horizontal_deg = 5;
  return lidar;
}

TEST(beam, wide_and_flat_has_one_range_to_flat_ground_all_around) {
  SceneConfig scene = empty_road();
  scene.ground.push_back(ground_at(-0.001));
  const Frame f = frame_of(world_with(scene, {}), wide_beam_lidar(-20));
  ASSERT_EQ(f.cloud.size(), 720U);
  const double middle = 6 / std::sin(rad(20));
  for (std::size_t i = 0; i < f.cloud.size(); ++i) {
    EXPECT_GT(norm(point(f.cloud, i)), middle);
    EXPECT_LT(norm(point(f.cloud, i)), middle / std::cos(rad(2.5)));
  }
}

/// Adds walls all around, higher than any beam and farther than any return. Without them, the
/// raycaster would leave out rays above all objects.
void surround(SceneConfig& scene) {
  for (int i = 0; i < 8; ++i) {
    BuildingConfig& wall = scene.buildings.emplace_back();
    wall.heading_deg = 45.0 * i;
    wall.x_m = 450 * std::cos(rad(wall.heading_deg));
    wall.y_m = 450 * std::sin(rad(wall.heading_deg));
    wall.width_m = 500;
    wall.height_m = 2000;
  }
}

TEST(beam, wide_sees_what_stands_beside_its_middle_whether_or_not_rays_are_left_out) {
  for (const double azimuth_deg : {0.0, 90.0, 180.0, -135.0})
    for (const double elevation_deg : {2.0, 30.0, 60.0})
      for (const bool wide : {true, false}) {
        SceneConfig scene = open_site();
        // The positions are 2.6 to 4 m beside a line through the middle of the beam.
        const double distance = 40 * std::cos(rad(elevation_deg)), side = wide ? 3.3 : 0;
        const Vec2 ahead = heading_vector(rad(azimuth_deg));
        BuildingConfig& tower = scene.buildings.emplace_back();
        tower.length_m = tower.width_m = 1.4;
        tower.heading_deg = azimuth_deg;
        tower.x_m = distance * ahead.x - side * ahead.y;
        tower.y_m = distance * ahead.y + side * ahead.x;
        tower.height_m = 6 + 40 * std::sin(rad(elevation_deg)) + (wide ? 6 : -1.5);
        LidarConfig lidar = beam_lidar(elevation_deg, 0.1);
        BeamConfig& beam = *lidar.units.front().returns.beam;
        (wide ? beam.horizontal_deg : beam.vertical_deg) = 8;
        const Frame f = frame_of(world_with(scene, {}), lidar);
        surround(scene);
        expect_equal(f.cloud, frame_of(world_with(scene, {}), lidar).cloud);
        EXPECT_GT(f.cloud.size(), 4U) << azimuth_deg << " " << elevation_deg << " " << wide;
      }
}

TEST(beam, wide_sees_vehicles_and_leaves_beside_its_middle_whether_or_not_rays_are_left_out) {
  SceneConfig scene = open_site();
  VegetationConfig tree;
  tree.tree = TreeConfig{.x_m = -20, .y_m = 3, .shape = {}, .place = {}};
  scene.vegetation.push_back(tree);
  ObjectState crane = car_on_road(1, -30, -3, 0);
  crane.box.dz = 12;
  crane.box.z = 6;
  LidarConfig lidar = beam_lidar(5, 0.1);
  lidar.units.front().returns.beam->horizontal_deg = 8;
  const Frame f = frame_of(world_with(scene, {crane}), lidar);
  surround(scene);
  expect_equal(f.cloud, frame_of(world_with(scene, {crane}), lidar).cloud);
  for (const Class seen : {Class::kCar, Class::kVegetation})
    EXPECT_GT(std::ranges::count(f.cloud.class_id, static_cast<std::uint16_t>(seen)), 8);
}

void set_direction(RayBatch& rays, std::size_t i, Vec3 d) {
  rays.dx[i] = static_cast<float>(d.x);
  rays.dy[i] = static_cast<float>(d.y);
  rays.dz[i] = static_cast<float>(d.z);
}

std::vector<std::uint32_t> every(const RayBatch& rays) {
  std::vector<std::uint32_t> all(rays.size());
  std::iota(all.begin(), all.end(), 0U);
  return all;
}

Vec3 direction(const RayBatch& rays, std::size_t i) { return {rays.dx[i], rays.dy[i], rays.dz[i]}; }

TEST(beam, turns_with_its_unit) {
  const Mat3 level = rotation(0, 0, 0), turned = rotation(rad(50), rad(30), rad(-10));
  for (const BeamConfig& config :
       {BeamConfig{.vertical_deg = 0.1, .horizontal_deg = 5},
        BeamConfig{.vertical_deg = 5, .horizontal_deg = 0.1, .sub_rays = 7}}) {
    RayBatch rays, turned_rays, sub_rays, turned_sub_rays;
    for (RayBatch* batch : {&rays, &turned_rays}) batch->resize(72);
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const Vec3 d = rotation(rad(5.0 * static_cast<double>(i)), rad(20), 0) * Vec3{1, 0, 0};
      set_direction(rays, i, d);
      set_direction(turned_rays, i, turned * d);
    }
    Beam(config, level).expand(rays, every(rays), 0, 7, sub_rays);
    Beam(config, turned).expand(turned_rays, every(turned_rays), 0, 7, turned_sub_rays);
    for (std::size_t i = 0; i < sub_rays.size(); ++i)
      EXPECT_LT(norm(turned * direction(sub_rays, i) - direction(turned_sub_rays, i)), 1e-6);
  }
}

TEST(beam, straight_down_is_at_the_sensors_height) {
  for (const bool wide : {true, false}) {
    const LidarConfig lidar = wide ? wide_beam_lidar(-90) : beam_lidar(-90, 5);
    const Frame f = frame_of(world_with(empty_road(), {}), lidar);
    ASSERT_EQ(f.cloud.size(), 720U);
    for (std::size_t i = 0; i < f.cloud.size(); ++i) EXPECT_NEAR(norm(point(f.cloud, i)), 6, 0.01);
  }
}

// --- ties ---

/// Returns rays to positions around the bottoms of two cars and around their common face. Many
/// positions are exactly on an edge.
RayBatch rays_at_shared_edges(const World& world, const std::vector<ObjectState>& cars) {
  std::vector<Vec3> targets;
  for (const ObjectState& car : cars)
    for (int i = -40; i <= 40; ++i)
      for (const double height : {-0.5, -0.4995, 0.25, 0.5})
        for (const Vec2 share : {Vec2{0.5, i / 80.0}, Vec2{-0.5, i / 80.0}, Vec2{i / 80.0, 0.5},
                                 Vec2{i / 80.0, -0.5}}) {
          const Box3d& b = car.box;
          const Vec2 along = heading_vector(b.heading), left = heading_vector(b.heading + kPi / 2);
          const Vec2 p = Vec2{b.x, b.y} + share.x * b.dx * along + share.y * b.dy * left;
          targets.push_back(world.level.to_level(Vec3{p.x, p.y, b.z + height * b.dz}));
        }
  RayBatch rays;
  rays.resize(targets.size());
  rays.max_range = 200;
  for (std::size_t i = 0; i < targets.size(); ++i)
    set_direction(rays, i, 1 / norm(targets[i]) * targets[i]);
  return rays;
}

TEST(hits, on_vehicles_that_touch_and_stand_on_the_road_do_not_depend_on_the_order_of_rays) {
  const std::vector cars{car_on_road(1, 12, -1.8, 0), car_on_road(2, 16.5, -1.8, 0),
                         car_on_road(3, 12, -3.7, 0), car_on_road(4, 16.5, -3.7, 0)};
  const World world = world_with(empty_road(), cars);
  Raycaster raycaster = world.raycaster();
  set_vehicles(world, 0, kUsualPeriod_s, 200, raycaster);
  const RayBatch rays = rays_at_shared_edges(world, cars);
  std::vector<std::uint32_t> order = every(rays);
  HitBatch in_order, shuffled;
  raycaster.cast(rays, order, in_order);
  EXPECT_GT(std::ranges::count(in_order.object, 0), 100);
  EXPECT_GT(std::ranges::count(in_order.object, -1), 100);
  std::mt19937 random(1);
  for (int round = 0; round < 20; ++round) {
    std::ranges::shuffle(order, random);
    raycaster.cast(rays, order, shuffled);
    for (std::size_t i = 0; i < rays.size(); ++i) {
      ASSERT_EQ(shuffled.range[i], in_order.range[i]) << "ray " << i;
      ASSERT_EQ(shuffled.object[i], in_order.object[i]) << "ray " << i;
      ASSERT_EQ(shuffled.class_id[i], in_order.class_id[i]) << "ray " << i;
    }
  }
}

TEST(hits, at_a_vehicles_foot_are_those_on_the_road_alone_and_on_vehicles_alone) {
  const std::vector cars{car_on_road(1, 12, -1.8, 0), car_on_road(2, 16.5, -1.8, 0)};
  const World both = world_with(empty_road(), cars), road = world_with(empty_road(), {});
  const MeshLibrary nothing({}, both.meshes->bodies);
  Raycaster together = both.raycaster(), on_road = road.raycaster(), on_vehicles(nothing);
  set_vehicles(both, 0, kUsualPeriod_s, 200, together);
  set_vehicles(road, 0, kUsualPeriod_s, 200, on_road);
  set_vehicles(both, 0, kUsualPeriod_s, 200, on_vehicles);
  const RayBatch rays = rays_at_shared_edges(both, cars);
  HitBatch all, still, moving;
  together.cast(rays, every(rays), all);
  on_road.cast(rays, every(rays), still);
  on_vehicles.cast(rays, every(rays), moving);
  for (std::size_t i = 0; i < rays.size(); ++i) {
    ASSERT_TRUE(still.range[i] != moving.range[i] || std::isinf(still.range[i])) << "tie " << i;
    const bool vehicle = moving.range[i] < still.range[i];
    ASSERT_EQ(all.range[i], vehicle ? moving.range[i] : still.range[i]) << "ray " << i;
    ASSERT_EQ(all.object[i], vehicle ? moving.object[i] : -1) << "ray " << i;
  }
}

// --- meshes -----------------------------------------------------------------------------------

TEST(frozen_mesh, has_the_vehicles_where_they_are_at_that_instant) {
  SceneConfig scene = empty_road();
  scene.mounts["pole"] = {.x_m = 3, .y_m = -7, .z_m = 5, .yaw_deg = 30};
  const World world = world_with(scene, {car_on_road(1, 20, -1.8, 0.2, 20)});
  const TriangleMesh mesh = frozen_mesh(world, 2, kUsualPeriod_s, 0.25);
  const std::size_t background = world.background().vertices.size();
  ASSERT_EQ(mesh.vertices.size(), background + world.meshes->bodies.front().vertices.size());
  EXPECT_EQ(mesh.class_id.size(), mesh.triangles.size());
  const Box3d box =
      world.level.to_level(body_box(world.trajectories->between(2, 3).front().at(0.25)));
  for (std::size_t i = background; i < mesh.vertices.size(); ++i)
    EXPECT_LT(
        distance_to_surface(box, {mesh.vertices[i][0], mesh.vertices[i][1], mesh.vertices[i][2]}),
        1e-4);
}

// --- learning a background ----------------------------------------------------------------------

TEST(background_filter, is_learnt_once_and_given_to_simulators) {
  SceneConfig scene = empty_road();
  scene.filters.push_back({BackgroundFilter{{}, 3}});
  const World world = world_with(scene, vehicles_around());
  const std::array lidars{fine_lidar()};
  const StaticLayers layers = make_static_layers(world, lidars);
  const LidarFilters learnt = FrameSimulator::learn_filters(world, lidars, layers);
  FrameSimulator built(world, lidars), given(world, lidars, layers, learnt);
  const Frame a = built.simulate(0, {true})[0], b = given.simulate(0, {true})[0];
  EXPECT_GT(a.cloud.size(), 0U);
  expect_equal(a.cloud, b.cloud);
  const std::vector<FilterStep> nothing{CropRange{0, 1e-3}};
  FrameSimulator blind(world, lidars, layers,
                       {std::make_shared<const std::vector<FilterStep>>(nothing)});
  EXPECT_EQ(blind.simulate(0, {true})[0].cloud.size(), 0U);
}

TEST(background_filter, is_the_same_object_in_all_threads) {
  SceneConfig scene = empty_road();
  scene.filters.push_back({BackgroundFilter{{}, 3}});
  const World world = world_with(scene, vehicles_around());
  std::mutex mutex;
  std::condition_variable changed;
  std::set<const FrameSimulator*> simulators;
  std::set<const void*> filters;
  Scheduler<int> scheduler(world, {fine_lidar()},
                           {.frames = {0, 0, 0, 0}, .threads = 2, .ahead = 4},
                           [&](FrameSimulator& simulator, int) {
                             std::unique_lock lock(mutex);
                             simulators.insert(&simulator);
                             filters.insert(simulator.filters().front().get());
                             changed.notify_all();
                             const auto both = [&] { return simulators.size() == 2; };
                             return changed.wait_for(lock, std::chrono::minutes(1), both) ? 1 : 0;
                           });
  while (const auto frame = scheduler.next()) EXPECT_EQ(frame->second, 1);
  EXPECT_EQ(simulators.size(), 2U);
  EXPECT_EQ(filters.size(), 1U);
}

TEST(background_filter, draws_noise_of_its_own) {
  // With the noise of the same frames, the farthest point of a cell would never be kept.
  SceneConfig scene = empty_road();
  scene.ground.push_back(ground_at(-0.5));
  BackgroundFilter learning;
  learning.frames = 1;
  learning.range_margin_m = learning.height_margin_m = 0;
  learning.azimuth_cell_deg = learning.elevation_cell_deg = 0.1;
  scene.filters.push_back({learning});
  LidarConfig lidar = fine_lidar();
  lidar.units.front().returns.range_accuracy_m = 0.03;
  const std::size_t built = frame_of(world_with(scene, {}), lidar, 0).cloud.size();
  const std::size_t other = frame_of(world_with(scene, {}), lidar, 1).cloud.size();
  EXPECT_GT(built, 1000U);
  EXPECT_NEAR(static_cast<double>(built) / static_cast<double>(other), 1, 0.1);
}

TEST(summary, has_exact_counts_and_means_of_six_decimals) {
  SummaryRow row;
  row.lidar = "own";
  row.preset = "equal";
  row.frames = 3;
  row.rays_per_frame = 1234567;
  row.hits_per_frame = 1234567 + 1.0 / 3;
  row.vehicles_per_frame = 30;
  row.vehicle_points_per_frame = 123456789.5;
  row.seconds = 0.00001;
  const std::string text = summary_csv({row});
  EXPECT_EQ(text.substr(text.find('\n') + 1),
            "own,equal,3,1234567,1234567.333333,30,123456789.5,0,0.00001,0\n");
}

}  // namespace
}  // namespace infrasim
