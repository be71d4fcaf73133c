#include <gtest/gtest.h>

#include <array>

#include "infrasim/pipeline/simulate.h"
#include "infrasim/scene/trajectories.h"
#include "infrasim/scene/trajectory_text.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::car_on_road;
using testing::empty_road;
using testing::plain_lidar;
using testing::spinning;
using testing::TestFolder;

constexpr double kGrade = 0.06;

/// Returns the trajectories of cars that drive up and down a grade along x and pass the mount.
Trajectories on_a_grade(double speed_m_s, int frames) {
  std::vector<ObjectState> cars{car_on_road(1, -30, 4, 0, speed_m_s),
                                car_on_road(2, 30, -4, kPi - 0.001, speed_m_s)};
  Trajectories out = testing::straight_on(cars, frames);
  out.pitched = true;
  for (auto& states : out.rows)
    for (ObjectState& s : states) {
      s.box.z += kGrade * s.box.x;
      s.box.pitch = -std::atan(kGrade) * (s.id == 1 ? 1 : -1);
    }
  return out;
}

World world_on_a_grade(double speed_m_s) {
  SceneConfig scene = empty_road();
  scene.detail = Detail::kLow;
  World world = build_world(scene);
  world.trajectories = std::make_shared<const Trajectories>(on_a_grade(speed_m_s, 10));
  return world;
}

/// Returns the distance of a point from a box; 0 if the point is inside.
double outside(const Box3d& box, Vec3 p) { return norm(p - BoxFrame(box).nearest(p)); }

TEST(pitch, points_of_a_vehicle_on_a_grade_lie_in_its_own_box) {
  for (const double speed : {0.0, 16.0}) {
    const World world = world_on_a_grade(speed);
    const std::array lidars{plain_lidar("turning", spinning(128, -25, 5, 0.1))};
    const Frame frame = FrameSimulator(world, lidars).simulate(3, {true}).front();
    const auto moving = world.trajectories->between(3, 4);
    std::array<int, 2> points{};
    double farthest_from_level = 0;
    for (std::size_t i = 0; i < frame.cloud.size(); ++i) {
      if (frame.cloud.object_id[i] < 0) continue;
      const auto car = static_cast<std::size_t>(frame.cloud.object_id[i] - 1);
      const Vec3 p{frame.cloud.xyz[3 * i], frame.cloud.xyz[3 * i + 1], frame.cloud.xyz[3 * i + 2]};
      Box3d box = world.level.to_level(moving[car].at(frame.cloud.time[i] / kUsualPeriod_s));
      EXPECT_LE(outside(box, p), 0.01) << "car " << car << " at " << speed << " m/s";
      box.pitch = 0;
      farthest_from_level = std::max(farthest_from_level, outside(box, p));
      ++points[car];
    }
    EXPECT_GT(points[0], 100);
    EXPECT_GT(points[1], 100);
    EXPECT_GT(farthest_from_level, 0.05);  // shows that the test can fail
    ASSERT_TRUE(frame.pitched);
    for (const ObjectRecord& o : frame.objects) {
      EXPECT_NEAR(std::abs(o.box.pitch), std::atan(kGrade), 1e-12);
      if (speed == 0) {
        EXPECT_EQ(o.points_in_box, o.points);
      }
    }
  }
}

TEST(pitch, a_vehicle_at_the_end_of_the_range_has_the_same_points_beside_a_longer_range) {
  ObjectState truck = car_on_road(1, 53.85, 0, 0);
  // The front of the truck is pitched down. An upper corner of the front points at the LiDAR, 49.6
  // m away.
  truck.box = {.x = 53.85, .y = 0, .z = 6, .dx = 7, .dy = 2.6, .dz = 4, .pitch = 0.5};
  truck.box.heading = kPi - std::atan2(2.6, levelled(truck.box).dx);
  World world = build_world(empty_road());  // bodies fill their boxes
  world.trajectories = std::make_shared<const Trajectories>(testing::straight_on({truck}, 1));
  std::array lidars{plain_lidar("short", spinning(64, -5, 5, 0.02)),
                    plain_lidar("long", spinning(4, -5, 5, 1))};
  lidars[0].units[0].returns.max_range_m = 50;
  const Frame both = FrameSimulator(world, lidars).simulate(0, {true, true}).front();
  const Frame alone = FrameSimulator(world, std::span(lidars).first(1)).simulate(0, {true}).front();
  EXPECT_GT(std::ranges::count(both.cloud.object_id, 1), 0);
  EXPECT_EQ(alone.cloud.xyz, both.cloud.xyz);
}

TEST(pitch, frozen_triangles_stand_where_rays_meet_them) {
  const World world = world_on_a_grade(0);
  const Box3d box = world.level.to_level(world.trajectories->between(3, 4)[0].at(0.5));
  const TriangleMesh mesh = frozen_mesh(world, 3, kUsualPeriod_s, 0.5);
  double highest = -kInf, lowest = kInf;
  for (std::size_t i = world.background().vertices.size(); i < mesh.vertices.size(); ++i) {
    const auto& v = mesh.vertices[i];
    if (v[1] < 0) continue;  // point of the other car
    EXPECT_LE(outside(box, {v[0], v[1], v[2]}), 1e-4);
    const Vec3 local = BoxFrame(box).to_box({v[0], v[1], v[2]});
    highest = std::max(highest, local.z);
    lowest = std::min(lowest, local.z);
  }
  EXPECT_NEAR(highest, box.dz / 2, 0.002);
  EXPECT_NEAR(lowest, -box.dz / 2, 0.002);
}

TEST(pitch, own_axes_and_back_are_the_same_and_the_nose_of_a_positive_one_is_low) {
  const BoxFrame frame({1, 2, 3, 4, 2, 1.5, 0.7, 0.1});
  const Vec3 nose = frame.from_box({2, 0, 0});
  EXPECT_NEAR(nose.z, 3 - 2 * std::sin(0.1), 1e-12);
  const Vec3 back = frame.to_box(nose);
  EXPECT_NEAR(back.x, 2, 1e-12);
  EXPECT_NEAR(back.y, 0, 1e-12);
  EXPECT_NEAR(back.z, 0, 1e-12);
  const Mat3 turn = rotation(0.7, 0.1, 0);
  const Vec3 same = turn * Vec3{0.5, -0.25, 0.125} + Vec3{1, 2, 3};
  EXPECT_NEAR(norm(same - frame.from_box({0.5, -0.25, 0.125})), 0, 1e-12);
}

TEST(pitch, a_levelled_box_holds_the_corners) {
  const Box3d box{1, 2, 3, 4.5, 2, 1.5, 0.7, -0.2};
  const BoxFrame level(levelled(box)), local(box);
  for (const double x : {-2.25, 2.25})
    for (const double z : {-0.75, 0.75})
      EXPECT_TRUE(level.contains(local.from_box({x, 1, z}), 1e-9));
}

TEST(pitch, is_the_last_column_of_trajectories_that_have_one) {
  const TestFolder folder;
  Trajectories written = on_a_grade(10, 5);
  for (auto& states : written.rows)
    for (ObjectState& s : states) s = rounded(s);
  const std::string text = trajectories_csv(written);
  EXPECT_TRUE(text.starts_with("t,id,class,x,y,z,heading,dx,dy,dz,speed,pitch\n"));
  const Trajectories back = read_trajectories(folder.write("file.csv", text));
  EXPECT_EQ(trajectories_csv(back), text);
  EXPECT_NEAR(back.rows[2][1].box.pitch, std::atan(kGrade), 1e-6);
  EXPECT_TRUE(back.pitched);
  written.pitched = false;
  EXPECT_TRUE(trajectories_csv(written).starts_with("t,id,class,x,y,z,heading,dx,dy,dz,speed\n"));
  const auto steep = folder.write("steep.csv",
                                  "t,id,class,x,y,z,heading,dx,dy,dz,speed,pitch\n"
                                  "0,1,Car,0,0,0,0,4,2,1.5,0,0.6\n");
  testing::expect_message(testing::error_of([&] { read_trajectories(steep); }), steep, 2, "pitch",
                          "got '0.6'");
}

}  // namespace
}  // namespace infrasim
