#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "infrasim/pipeline/scan_time.h"
#include "infrasim/pipeline/simulate.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::car_on_road;
using testing::configs;
using testing::empty_road;
using testing::frame_of;
using testing::plain_lidar;
using testing::point;
using testing::spinning;
using testing::straight_on;
using testing::world_with;

constexpr double kMiddle_s = kUsualPeriod_s / 2;

/// Returns a LiDAR that looks 0 to 20 degrees down, with azimuth steps of 0.2 degrees.
LidarConfig fine_lidar() { return plain_lidar("lidar", spinning(41, -20, 0, 0.2)); }

/// Returns cars with speeds of 14 to 20 m/s ahead of the mount, behind it and beside it.
std::vector<ObjectState> cars_around() {
  return {car_on_road(1, 12, -1.8, 0, 20),  car_on_road(2, 25, -1.8, 0, 20),
          car_on_road(3, 18, 1.8, kPi, 15), car_on_road(4, -20, 1.8, kPi, 14),
          car_on_road(5, -14, -1.8, 0, 18), car_on_road(6, -2, -9, 0.4, 16)};
}

/// Returns the firing times of the points on a vehicle, in increasing order.
std::vector<double> times_of(const Frame& f, int id) {
  std::vector<double> times;
  for (std::size_t i = 0; i < f.cloud.size(); ++i)
    if (f.cloud.object_id[i] == id) times.push_back(f.cloud.time[i]);
  std::ranges::sort(times);
  return times;
}

/// Returns the largest distance from a box to a vehicle's points outside the box. Only points that
/// were fired within `within_s` of `time_s` count.
double farthest_outside(const Frame& f, int id, const Box3d& box, double time_s, double within_s) {
  double farthest = 0;
  for (std::size_t i = 0; i < f.cloud.size(); ++i) {
    if (f.cloud.object_id[i] != id || std::abs(f.cloud.time[i] - time_s) > within_s) continue;
    const Vec3 p = point(f.cloud, i);
    const Vec2 d{p.x - box.x, p.y - box.y}, axis = heading_vector(box.heading);
    farthest =
        std::max({farthest, std::abs(dot(axis, d)) - box.dx / 2,
                  std::abs(cross(axis, d)) - box.dy / 2, std::abs(p.z - box.z) - box.dz / 2});
  }
  return farthest;
}

// --- the time of a scan -----------------------------------------------------------------------

TEST(scan_time, is_the_mean_of_the_returns) {
  std::vector<double> times{0.01, 0.02, 0.06};
  EXPECT_NEAR(scan_time_s(times, 0.05), 0.03, 1e-12);
}

TEST(scan_time, of_a_vehicle_that_the_cut_angle_splits_is_that_of_the_larger_group) {
  std::vector<double> times{0.099, 0.001, 0.097, 0.098};
  EXPECT_NEAR(scan_time_s(times, 0.05), 0.098, 1e-12);
  times = {0.001, 0.002, 0.098, 0.003};
  EXPECT_NEAR(scan_time_s(times, 0.05), 0.002, 1e-12);
  times = {0.09, 0.01};
  EXPECT_NEAR(scan_time_s(times, 0.05), 0.01, 1e-12) << "of equal groups the first";
  times = {0.01, 0.09};
  EXPECT_NEAR(scan_time_s(times, kInf), 0.05, 1e-12) << "nothing turns, so nothing is cut";
}

TEST(scan_time, of_long_looks_without_a_pause_is_their_mean) {
  std::vector<double> times{0.0, 0.04, 0.08};
  EXPECT_NEAR(scan_time_s(times, 0.05), 0.04, 1e-12);
}

TEST(cut, is_half_a_turn_of_a_unit_that_spins) {
  LidarConfig lidar = fine_lidar();
  EXPECT_NEAR(cut_s(lidar), 0.05, 1e-12);
  lidar.units.front().pattern.spinning->rate_hz = 5;
  EXPECT_NEAR(cut_s(lidar), 0.1, 1e-12);
  lidar.units.front().pattern.spinning->rate_hz = 20;
  EXPECT_NEAR(cut_s(lidar), 0.025, 1e-12);
  EXPECT_EQ(cut_s(read_lidar(configs() / "lidars/livox_avia.yaml", "paper")), kInf);
}

// --- where the label is -----------------------------------------------------------------------

/// Checks that the box at scan time contains the vehicle's points. A point may lie outside by at
/// most the distance that the vehicle moves during the scan.
void expect_enclosed(const Frame& f) {
  int vehicles = 0;
  for (const ObjectRecord& o : f.objects) {
    const std::vector<double> times = times_of(f, o.id);
    if (times.size() < 20 || times.back() - times.front() > 0.05)
      continue;  // the cut angle has split this vehicle
    const double sweep = std::max(times.back() - o.scan_time_s, o.scan_time_s - times.front());
    EXPECT_LT(farthest_outside(f, o.id, o.scan_box, kMiddle_s, 1), o.speed_m_s * sweep + 1e-3);
    EXPECT_GT(o.points_in_scan_box, 0.4 * o.points) << o.id;
    ++vehicles;
  }
  EXPECT_GE(vehicles, 4);
}

TEST(label_at_the_scan, encloses_the_points_wherever_the_mount_looks) {
  for (const double yaw : {0, 90, 180, -90}) {
    SCOPED_TRACE(yaw);
    SceneConfig scene = empty_road();
    scene.mounts["pole"].yaw_deg = yaw;
    expect_enclosed(frame_of(world_with(scene, cars_around()), fine_lidar(), 3));
  }
}

TEST(label_at_the_scan, encloses_the_points_wherever_the_cut_angle_is) {
  double worst_of_frame = 0;
  for (int cut_angle = 0; cut_angle < 360; cut_angle += 45) {
    SCOPED_TRACE(cut_angle);
    LidarConfig lidar = fine_lidar();
    lidar.units.front().pattern.spinning->cut_angle_deg = cut_angle;
    const Frame f = frame_of(world_with(empty_road(), cars_around()), lidar, 3);
    expect_enclosed(f);
    for (const ObjectRecord& o : f.objects)
      worst_of_frame = std::max(worst_of_frame, farthest_outside(f, o.id, o.box, kMiddle_s, 1));
  }
  EXPECT_GT(worst_of_frame, 0.5) << "labels at mid-frame do not";
}

TEST(label_at_the_scan, is_at_the_mean_time_of_the_returns_on_the_trajectory) {
  const World world = world_with(empty_road(), cars_around());
  const Frame f = frame_of(world, fine_lidar(), 3);
  int moved = 0;
  for (const ObjectRecord& o : f.objects) {
    const std::vector<double> times = times_of(f, o.id);
    if (times.empty() || times.back() - times.front() > 0.05) continue;
    double mean = 0;
    for (const double t : times) mean += t / static_cast<double>(times.size());
    EXPECT_NEAR(o.scan_time_s, mean, 1e-6);
    const double way = std::hypot(o.scan_box.x - o.box.x, o.scan_box.y - o.box.y);
    EXPECT_NEAR(way, o.speed_m_s * std::abs(mean - kMiddle_s), 1e-4);
    EXPECT_EQ(o.scan_box.dx, o.box.dx);
    moved += way > 0.3;
  }
  EXPECT_GT(moved, 1);
}

TEST(label_at_the_scan, turns_with_a_vehicle_that_turns) {
  World world = world_with(empty_road(), {car_on_road(1, 15, 0, 0)});
  Trajectories turning = *world.trajectories;
  turning.rows[4][0].box.heading = 0.2;  // the heading is 0 in frame 3
  world.trajectories = std::make_shared<const Trajectories>(turning);
  const Frame f = frame_of(world, fine_lidar(), 3);
  const ObjectRecord& o = f.objects.at(0);
  EXPECT_NEAR(o.box.heading, 0.1, 1e-9);
  EXPECT_NEAR(o.scan_box.heading, 0.2 * o.scan_time_s / kUsualPeriod_s, 1e-9);
  EXPECT_GT(std::abs(o.scan_box.heading - 0.1), 0.05);
}

TEST(label_at_the_scan, of_a_vehicle_without_returns_is_that_of_mid_frame) {
  // The second car is as long as the shadow of the first car.
  LidarConfig lidar = fine_lidar();
  lidar.units.front().returns.max_range_m = 40;
  std::vector<ObjectState> cars{car_on_road(1, 12, -1.8, 0, 20)};
  cars.push_back(car_on_road(2, 0.5, -1.8, 0, 20));  // below the lowest line
  const Frame f = frame_of(world_with(empty_road(), cars), lidar, 0);
  const ObjectRecord& hidden = f.objects.at(1);
  EXPECT_EQ(hidden.points, 0);
  EXPECT_EQ(hidden.scan_time_s, kMiddle_s);
  EXPECT_EQ(hidden.scan_box.x, hidden.box.x);
  EXPECT_EQ(hidden.scan_box.y, hidden.box.y);
  EXPECT_EQ(hidden.scan_box.heading, hidden.box.heading);
  EXPECT_NE(f.objects.at(0).scan_box.x, f.objects.at(0).box.x);
}

TEST(label_at_the_scan, of_a_vehicle_that_the_cut_angle_splits_is_that_of_its_larger_part) {
  // The sensor turns clockwise and begins straight ahead. Points to the right of the cut angle are
  // scanned first, and points to its left last.
  for (const auto& [y, first] : {std::pair{-0.4, true}, {0.4, false}}) {
    SCOPED_TRACE(y);
    const Frame f =
        frame_of(world_with(empty_road(), {car_on_road(1, 15, y, 0, 20)}), fine_lidar(), 3);
    const ObjectRecord& o = f.objects.at(0);
    const std::vector<double> times = times_of(f, 1);
    ASSERT_LT(times.front(), 0.01);
    ASSERT_GT(times.back(), 0.09);
    EXPECT_TRUE(first ? o.scan_time_s < 0.01 : o.scan_time_s > 0.09) << o.scan_time_s;
    EXPECT_LT(farthest_outside(f, 1, o.scan_box, o.scan_time_s, 0.05), 20 * 0.003);
  }
}

TEST(label_at_the_scan, of_a_bundle_is_at_the_mean_of_all_its_units) {
  const World world = world_with(empty_road(), {car_on_road(1, 15, -3, 0, 20)});
  LidarConfig first = fine_lidar(), second = fine_lidar(), both = fine_lidar();
  second.units.front().pattern.spinning->cut_angle_deg = 120;
  both.units.push_back(second.units.front());
  const ObjectRecord a = frame_of(world, first, 3).objects.at(0),
                     b = frame_of(world, second, 3).objects.at(0);
  const ObjectRecord whole = frame_of(world, both, 3).objects.at(0);
  EXPECT_GT(std::abs(a.scan_time_s - b.scan_time_s), 0.03);
  EXPECT_NEAR(whole.scan_time_s,
              (a.points * a.scan_time_s + b.points * b.scan_time_s) / (a.points + b.points), 1e-6);
}

TEST(label_at_the_scan, knows_the_returns_that_a_filter_removes) {
  SceneConfig scene = empty_road();
  const std::vector cars{car_on_road(1, 15, -3, 0, 20)};
  const ObjectRecord all = frame_of(world_with(scene, cars), fine_lidar(), 3).objects.at(0);
  scene.filters.push_back({CropRange{.min_m = 0, .max_m = 16}});
  const ObjectRecord some = frame_of(world_with(scene, cars), fine_lidar(), 3).objects.at(0);
  EXPECT_LT(some.points, all.points);
  EXPECT_EQ(some.scan_time_s, all.scan_time_s);
  scene.filters[0] = {CropRange{.min_m = 0, .max_m = 5}};
  const ObjectRecord none = frame_of(world_with(scene, cars), fine_lidar(), 3).objects.at(0);
  EXPECT_EQ(none.points, 0);
  EXPECT_EQ(none.points_in_box + none.points_in_scan_box, 0);
  EXPECT_EQ(none.scan_box.x, all.scan_box.x);
}

TEST(label_at_the_scan, of_a_frozen_world_is_where_it_was_frozen) {
  SceneConfig scene = empty_road();
  scene.aggregation = parse_aggregation("instant").value();
  for (const ObjectRecord& o :
       frame_of(world_with(scene, cars_around()), fine_lidar(), 3).objects) {
    EXPECT_NEAR(o.scan_time_s, kMiddle_s, 1e-12);
    EXPECT_NEAR(o.scan_box.x, o.box.x, 1e-9);
  }
  scene.aggregation = parse_aggregation("slices:2").value();
  const Frame f = frame_of(world_with(scene, {car_on_road(1, 15, -3, 0, 20)}), fine_lidar(), 3);
  EXPECT_NEAR(f.objects.at(0).scan_time_s, 0.025, 1e-12);
  EXPECT_EQ(f.objects.at(0).points_in_scan_box, f.objects.at(0).points);
}

// --- points in the box ------------------------------------------------------------------------

TEST(points_in_the_box, are_all_of_them_in_a_frozen_world_whatever_the_noise_and_the_beam) {
  SceneConfig scene = empty_road();
  scene.aggregation = parse_aggregation("instant").value();
  const World world = world_with(scene, cars_around());
  for (const char* name : {"ruby_plus", "helios_16", "livox_avia", "bundle_5_livox_avia"}) {
    SCOPED_TRACE(name);
    const Frame f = frame_of(
        world, read_lidar(configs() / "lidars" / (std::string(name) + ".yaml"), "datasheet"), 3);
    int points = 0;
    for (const ObjectRecord& o : f.objects) {
      EXPECT_EQ(o.points_in_box, o.points) << o.id;
      EXPECT_EQ(o.points_in_scan_box, o.points) << o.id;
      points += o.points;
    }
    EXPECT_GT(points, 100);
  }
}

TEST(points_in_the_box, do_not_depend_on_range_noise) {
  const World world = world_with(empty_road(), cars_around());
  LidarConfig noisy = fine_lidar();
  noisy.units.front().returns.range_accuracy_m = 0.1;
  const Frame a = frame_of(world, fine_lidar(), 3), b = frame_of(world, noisy, 3);
  int outside = 0;
  for (std::size_t i = 0; i < a.objects.size(); ++i) {
    EXPECT_EQ(a.objects[i].points, b.objects[i].points);
    EXPECT_EQ(a.objects[i].points_in_box, b.objects[i].points_in_box);
    EXPECT_EQ(a.objects[i].points_in_scan_box, b.objects[i].points_in_scan_box);
    outside += a.objects[i].points - a.objects[i].points_in_box;
  }
  EXPECT_GT(outside, 10);
}

}  // namespace
}  // namespace infrasim
