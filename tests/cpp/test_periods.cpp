#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "infrasim/config/lidar_changes.h"
#include "infrasim/pipeline/frame_stream.h"
#include "infrasim/pipeline/observer.h"
#include "infrasim/pipeline/run.h"
#include "infrasim/pipeline/run_folder.h"
#include "infrasim/pipeline/simulate.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::car_on_road;
using testing::configs;
using testing::distance_to_surface;
using testing::empty_road;
using testing::error_of;
using testing::frame_of;
using testing::plain_lidar;
using testing::point;
using testing::spinning;
using testing::straight_on;
using testing::world_with;

/// Returns a LiDAR that looks 0 to 20 degrees down, with 1800 columns per turn at 10 Hz. A turn
/// begins behind the sensor, so that it does not split a car ahead.
LidarConfig fine_lidar(double rate_hz) {
  PatternConfig pattern = spinning(41, -20, 0, 0.2);
  pattern.spinning->cut_angle_deg = 180;
  return with_rate(plain_lidar("lidar", pattern), rate_hz);
}

/// Returns the trajectory of a car that brakes from 20 m/s and turns.
Trajectories braking(int steps) {
  Trajectories out;
  for (int k = 0; k <= steps; ++k) {
    const double t = k * kRowStep_s;
    out.rows.push_back({car_on_road(1, 12 + 20 * t - 2 * t * t, -1.8, 0.05 * t, 20 - 4 * t)});
  }
  return out;
}

TEST(period, is_that_of_one_turn_or_the_key) {
  LidarConfig lidar = fine_lidar(10);
  EXPECT_EQ(period_s(lidar), 0.1);
  EXPECT_EQ(period_s(fine_lidar(20)), 0.05);
  lidar = read_lidar(configs() / "lidars/livox_avia.yaml", "datasheet");
  EXPECT_EQ(period_s(lidar), 0.1);
  lidar = with_rate(lidar, 5);
  EXPECT_EQ(period_s(lidar), 0.2);
  const testing::TestFolder folder;
  const auto file = folder.write("avia.yaml", dump_lidar(lidar));
  EXPECT_EQ(period_s(read_lidar(file, "datasheet")), 0.2);
}

TEST(rate, changes_the_columns_of_a_turn_and_not_the_firing_cycle) {
  for (const char* name : {"ruby_plus", "velodyne_hdl_64e", "hesai_xt32", "velodyne_vlp_16"}) {
    const LidarConfig lidar =
        read_lidar(configs() / "lidars" / (std::string(name) + ".yaml"), "datasheet");
    const SpinningConfig& before = *lidar.units[0].pattern.spinning;
    for (const double rate_hz : {5.0, 15.0, 20.0}) {
      const LidarConfig other = with_rate(lidar, rate_hz);
      const SpinningConfig& after = *other.units[0].pattern.spinning;
      EXPECT_EQ(after.rate_hz, rate_hz);
      EXPECT_NEAR(columns_per_s(after) / columns_per_s(before), 1, 1e-12) << name;
      const Fraction from = *columns_per_turn(before), to = *columns_per_turn(after);
      EXPECT_EQ(from.numerator * 10 * to.denominator,
                to.numerator * static_cast<std::int64_t>(rate_hz) * from.denominator)
          << name << " " << rate_hz;
    }
    EXPECT_EQ(dump_lidar(with_rate(with_rate(lidar, 20), 10)), dump_lidar(lidar)) << name;
  }
}

TEST(rate, beyond_its_limits_is_an_error) {
  for (const double rate_hz : {4.9, 20.1, 0.0, -10.0, std::nan("")})
    EXPECT_NE(error_of([&] { fine_lidar(rate_hz); }).find("rate_hz: expected 5 to 20, got"),
              std::string::npos);
}

TEST(periods, that_differ_are_refused_in_one_run) {
  const SceneConfig scene = empty_road();
  LidarConfig fast = fine_lidar(20);
  fast.name = "fast";
  const std::vector<LidarConfig> both{fine_lidar(10), fast};
  const std::string reason =
      "expected one frame period in a run, got lidar with 0.1 s and fast with 0.05 s";
  const World world = build_world(scene);
  EXPECT_NE(error_of([&] { FrameStream(world, both, {0}, 1); }).find(reason), std::string::npos);
  RunRequest request;
  request.scene = scene;
  request.lidars = both;
  request.frames = {0, 1, 1};
  const std::atomic<int> stop = 0;
  const std::string refused =
      error_of([&] { run(request, stop, [](int, int) {}, [](const std::string&) {}); });
  EXPECT_NE(refused.find(reason), std::string::npos) << refused;
  const std::array<int, 1> frames{0};
  const Observer observer(scene, "", frames, 0.1);
  EXPECT_NE(error_of([&] {
              observer.observe(scene.mounts.begin()->second, std::array{fast}, frames);
            }).find("fast: expected the observer's frame period of 0.1 s, got 0.05 s"),
            std::string::npos);
}

TEST(frame_of_a_period, has_one_turn_whose_points_lie_on_the_vehicle_at_their_times) {
  World world = build_world(empty_road());
  world.trajectories = std::make_shared<const Trajectories>(braking(10));
  for (const double rate_hz : {5.0, 10.0, 20.0}) {
    const LidarConfig lidar = fine_lidar(rate_hz);
    const double frame_s = 1 / rate_hz;
    int points = 0, in_box = 0, frames = 0;
    for (int k = 0; k < world.frames(frame_s); ++k) {
      const Frame f = frame_of(world, lidar, k);
      EXPECT_EQ(f.rays, static_cast<std::size_t>(18000 / rate_hz) * 41);
      const auto objects = world.objects_in_frame(k, frame_s);
      ASSERT_EQ(objects.size(), 1U);
      for (std::size_t i = 0; i < f.cloud.size(); ++i) {
        EXPECT_LT(f.cloud.time[i], frame_s);
        if (f.cloud.object_id[i] < 0) continue;
        const Box3d box = world.level.to_level(objects[0].at(f.cloud.time[i] / frame_s));
        EXPECT_LT(distance_to_surface(box, point(f.cloud, i)), 1e-3) << rate_hz << " Hz";
      }
      for (const ObjectRecord& o : f.objects) {
        points += o.points;
        in_box += o.points_in_scan_box;
        ++frames;
      }
    }
    EXPECT_EQ(frames, static_cast<int>(rate_hz));
    EXPECT_GT(points, 100);
    EXPECT_GT(in_box, 0.9 * points) << rate_hz << " Hz";  // the car moves during its scan
  }
}

TEST(frame_of_a_period, begins_where_the_frame_before_it_ends) {
  SceneConfig scene = empty_road();
  scene.mounts["pole"].clock_offset_s = 0.013;
  for (const bool late : {false, true}) {
    if (!late) scene.mounts["pole"].clock_offset_s.reset();
    World world = build_world(scene);
    world.trajectories = std::make_shared<const Trajectories>(braking(10));
    for (const double frame_s : {0.05, 1 / 15.0, 0.1, 0.2})
      for (int k = 1; k < world.frames(frame_s); ++k) {
        const auto before = world.objects_in_frame(k - 1, frame_s);
        const auto after = world.objects_in_frame(k, frame_s);
        ASSERT_EQ(before.size(), 1U);
        EXPECT_EQ(before[0].to, after[0].from) << frame_s << " " << k;
      }
  }
}

TEST(frame_of_a_period, of_20_hz_is_half_of_a_frame_of_10_hz) {
  World world = build_world(empty_road());
  world.trajectories = std::make_shared<const Trajectories>(braking(10));
  for (int k = 0; k < world.frames(0.1); ++k) {
    const MovingObject whole = world.objects_in_frame(k, 0.1).at(0);
    const MovingObject first = world.objects_in_frame(2 * k, 0.05).at(0);
    const MovingObject second = world.objects_in_frame(2 * k + 1, 0.05).at(0);
    EXPECT_EQ(first.from, whole.from);
    EXPECT_EQ(second.to, whole.to);
    EXPECT_EQ(first.to, second.from);
    EXPECT_NEAR(first.to.x, whole.at(0.5).x, 1e-4);  // states are rounded
    EXPECT_NEAR(first.to.heading, whole.at(0.5).heading, 1e-6);
  }
}

TEST(frames_of_a_period, are_the_whole_ones_in_the_duration) {
  EXPECT_EQ(frame_count(60, 0.1), 600);
  EXPECT_EQ(frame_count(60, 0.05), 1200);
  EXPECT_EQ(frame_count(60, 0.2), 300);
  EXPECT_EQ(frame_count(60, 1 / 15.0), 900);
  EXPECT_EQ(frame_count(0.3, 0.2), 1);
  const World world = world_with(empty_road(), {});
  EXPECT_NO_THROW(frame_of(world, fine_lidar(20), 19));
  error_of([&] { frame_of(world, fine_lidar(20), 20); });
  error_of([&] { frame_of(world, fine_lidar(5), 5); });
}

TEST(static_layer_of_a_period, gives_the_frames_of_casting_all) {
  const World world = world_with(empty_road(), {car_on_road(1, 12, -1.8, 0, 20)});
  for (const double rate_hz : {5.0, 20.0}) {
    const std::array lidars{fine_lidar(rate_hz)};
    const auto turn = make_static_layers(world, lidars, 1);
    ASSERT_NE(turn[0][0], nullptr) << "one frame has all rays of a turn";
    FrameSimulator with(world, lidars, turn), without(world, lidars, StaticLayers{});
    for (const int k : {0, 3})
      testing::expect_equal(with.simulate(k, {true})[0].cloud,
                            without.simulate(k, {true})[0].cloud);
  }
}

TEST(lidar_yaml, has_the_period) {
  const World world = build_world(empty_road());
  EXPECT_NE(lidar_yaml(world, fine_lidar(20)).find("\nperiod_s: 0.05\n"), std::string::npos);
  EXPECT_NE(lidar_yaml(world, fine_lidar(10)).find("\nperiod_s: 0.1\n"), std::string::npos);
}

}  // namespace
}  // namespace infrasim
