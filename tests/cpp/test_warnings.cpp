// Tests that implausible trajectories, meshes and LiDARs give a warning or an error.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "infrasim/config/lidar_checks.h"
#include "infrasim/pipeline/observer.h"
#include "infrasim/pipeline/world.h"
#include "infrasim/scene/traffic_checks.h"
#include "infrasim/scene/trajectory_text.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::car_on_road;
using testing::expect_within;
using testing::straight_on;

/// Makes the text of a .ply file of rectangles, whose coordinates are multiplied by `scale`.
class Mesh {
 public:
  explicit Mesh(double scale = 1) : scale_(scale) {}

  Mesh& quad(const std::array<Vec3, 4>& corners) {
    const std::string first = std::to_string(count_);
    for (const Vec3& p : corners) {
      vertices_ += std::to_string(scale_ * p.x) + " " + std::to_string(scale_ * p.y) + " " +
                   std::to_string(scale_ * p.z) + "\n";
      ++count_;
    }
    faces_ += "4 " + first;
    for (int i = 1; i < 4; ++i) faces_ += " " + std::to_string(count_ - 4 + i);
    faces_ += '\n';
    ++face_count_;
    return *this;
  }
  Mesh& floor(double x0, double x1, double y0, double y1, double z) {
    return quad({Vec3{x0, y0, z}, {x1, y0, z}, {x1, y1, z}, {x0, y1, z}});
  }
  /// Adds four walls without a roof or a floor.
  Mesh& walls(double x0, double x1, double y0, double y1, double low, double high) {
    const std::array<Vec2, 5> around{Vec2{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}, {x0, y0}};
    for (std::size_t i = 0; i < 4; ++i) {
      const Vec2 a = around.at(i), b = around.at(i + 1);
      quad({Vec3{a.x, a.y, low}, {b.x, b.y, low}, {b.x, b.y, high}, {a.x, a.y, high}});
    }
    return *this;
  }
  std::string ply() const {
    return "ply\nformat ascii 1.0\nelement vertex " + std::to_string(count_) +
           "\nproperty double x\nproperty double y\nproperty double z\nelement face " +
           std::to_string(face_count_) + "\nproperty list uchar int vertex_indices\nend_header\n" +
           vertices_ + faces_;
  }

 private:
  double scale_;
  std::string vertices_, faces_;
  int count_ = 0, face_count_ = 0;
};

Mesh road(double scale = 1) { return Mesh(scale).floor(-150, 150, -4, 4, 0); }
/// Returns a house of 20 x 15 m beside the road, 10 m high, without a floor.
Mesh house() { return Mesh().walls(-10, 10, 10, 25, 0, 10).floor(-10, 10, 10, 25, 10); }

/// An imported site: two lanes along x, a road, a house, and recorded vehicles.
class ImportedSite : public ::testing::Test {
 protected:
  ImportedSite() {
    write("lanes.csv",
          "lane,x,y,z,width\nup,-150,-2,0,3.5\nup,150,-2,0,3.5\n"
          "down,150,2,0,3.5\ndown,-150,2,0,3.5\n");
    write("road.ply", road().ply());
    write("house.ply", house().ply());
    record({});
  }

  std::filesystem::path write(const std::string& name, const std::string& text) const {
    return folder_.write(name, text);
  }
  void record(const std::vector<ObjectState>& at_start) const {
    write("cars.csv", trajectories_csv(straight_on(at_start, 50)));
  }
  SceneConfig scene(const std::string& mount = "x_m: 0, y_m: -7, z_m: 6") const {
    SceneConfig out =
        parse_scene("name: site\nduration_s: 5\nmounts: {pole: {" + mount +
                        "}}\nlanes: lanes.csv\nmeshes: [{file: road.ply, material: road}, "
                        "{file: house.ply, material: structure}]\ntrajectories: cars.csv\n",
                    "site.yaml");
    out.folder = folder_.path();
    return out;
  }
  std::vector<std::string> warnings() const {
    const std::vector<std::string> checked = check_worlds(scene(), true);
    EXPECT_EQ(build_world(scene()).warnings, checked);  // `run` warns as `check` does
    return checked;
  }

  testing::TestFolder folder_;
};

ObjectState raised(ObjectState state, double metres) {
  state.box.z += metres;
  return state;
}

/// Returns the rows of a car with its box turned by `angle`, but with its motion unchanged.
std::vector<std::vector<ObjectState>> turned(const std::vector<std::vector<ObjectState>>& rows,
                                             double angle) {
  auto out = rows;
  for (auto& row : out)
    for (ObjectState& s : row) s.box.heading += angle;
  return out;
}

TEST_F(ImportedSite, of_plausible_vehicles_has_no_warning) {
  record({car_on_road(1, -40, -2, 0, 10), car_on_road(2, 40, 2, kPi, 10),
          raised(car_on_road(3, -20, -2, 0, 10), 0.6), car_on_road(4, 20, 30, 0, 10)});
  EXPECT_EQ(warnings(), std::vector<std::string>{});
}

TEST_F(ImportedSite, with_a_vehicle_3_m_above_its_lane_has_a_warning) {
  record({car_on_road(1, -40, -2, 0, 10), raised(car_on_road(2, 40, 2, kPi, 10), 3)});
  const auto lines = warnings();
  ASSERT_EQ(lines.size(), 1U);
  expect_within(lines[0],
                "cars.csv: z: expected vehicles within 1 m of the height of a lane, got 1 "
                "of 2 vehicles above or below, such as 2 at 0 s, x 40, y 2, which is 3 m "
                "above");
}

TEST_F(ImportedSite, with_a_vehicle_below_its_lane_has_a_warning) {
  record({raised(car_on_road(2, 40, 2, kPi, 10), -1.5)});
  const auto lines = warnings();
  ASSERT_EQ(lines.size(), 1U);
  expect_within(lines[0], "1.5 m below");
}

TEST_F(ImportedSite, with_a_vehicle_that_drives_sideways_has_a_warning) {
  Trajectories cars = straight_on({car_on_road(1, -40, -2, 0, 10)}, 50);
  for (const double angle : {0.0, kPi, 0.4, -0.4}) {
    cars.rows = turned(straight_on({car_on_road(1, -40, -2, 0, 10)}, 50).rows, angle);
    write("cars.csv", trajectories_csv(cars));
    EXPECT_EQ(warnings(), std::vector<std::string>{}) << angle;
  }
  for (const double angle : {kPi / 2, -kPi / 2, 0.6, 2.4}) {
    cars.rows = turned(straight_on({car_on_road(1, -40, -2, 0, 10)}, 50).rows, angle);
    write("cars.csv", trajectories_csv(cars));
    const auto lines = warnings();
    ASSERT_EQ(lines.size(), 1U) << angle;
    expect_within(lines[0],
                  "cars.csv: heading: expected the direction of motion, in radians from x "
                  "to y, got 1 of 1 vehicles that drive sideways, such as 1 at ");
  }
}

TEST_F(ImportedSite, with_vehicles_that_are_wider_than_long_has_a_warning) {
  ObjectState wide = car_on_road(1, -40, -2, 0, 10);
  std::swap(wide.box.dx, wide.box.dy);
  record({wide});
  const auto lines = warnings();
  ASSERT_EQ(lines.size(), 1U);
  expect_within(lines[0],
                "got 1 of 1 vehicles that are wider than long, such as 1 of 1.9 by 4.5 m");
}

TEST_F(ImportedSite, with_vehicles_in_one_place_has_a_warning) {
  record({car_on_road(1, -40, -2, 0, 10), car_on_road(2, -38, -2, 0, 10),
          car_on_road(3, 40, 2, kPi, 10)});
  const auto lines = warnings();
  ASSERT_EQ(lines.size(), 1U);
  expect_within(lines[0],
                "cars.csv: (vehicles): expected vehicles apart, got 1 and 2 in one place "
                "at 0 s, x -39, y -2");
}

TEST_F(ImportedSite, with_a_mesh_in_centimetres_or_millimetres_has_a_warning) {
  for (const double scale : {100.0, 1000.0}) {
    write("road.ply", road(scale).ply());
    const auto lines = warnings();
    ASSERT_EQ(lines.size(), 1U);
    expect_within(lines[0], "road.ply: expected metres, got a surface of ");
    expect_within(lines[0], "beside roads of 300 m");
  }
  write("road.ply", road().ply());
  write("house.ply", Mesh(1000).walls(30, 30.3, 10, 10.3, 0, 8).ply());  // a pole
  ASSERT_EQ(warnings().size(), 1U);
  write("house.ply", Mesh(100).walls(30, 30.3, 10, 10.3, 0, 8).ply());
  ASSERT_EQ(warnings().size(), 1U);
}

TEST_F(ImportedSite, with_terrain_of_3_km_and_a_tower_of_200_m_has_no_warning) {
  write("house.ply",
        Mesh().floor(-1500, 1500, -1500, 1500, -5).walls(400, 430, 400, 430, 0, 200).ply());
  EXPECT_EQ(warnings(), std::vector<std::string>{});
}

TEST_F(ImportedSite, has_no_mount_inside_a_house) {
  const Observer observer(scene(), "pole", std::vector<int>{0}, kUsualPeriod_s);
  const auto fault = [&](double x, double y, double z) {
    const std::string at =
        "x_m: " + std::to_string(x) + ", y_m: " + std::to_string(y) + ", z_m: " + std::to_string(z);
    MountConfig pose = scene().mounts.begin()->second;
    pose.x_m = x;
    pose.y_m = y;
    pose.z_m = z;
    // The planner refuses the poses that `check` and `run` refuse.
    const std::string of_planner = observer.fault(pose);
    std::string of_check;
    try {
      check_worlds(scene(at), false);
    } catch (const ConfigError& error) {
      of_check = error.what();
    }
    EXPECT_EQ(of_planner.empty(), of_check.empty()) << of_planner << "\n" << of_check;
    return of_check;
  };
  expect_within(fault(0, 15, 3), "site.yaml:3:");
  expect_within(fault(0, 15, 3), "mounts.pole.x_m: expected a position outside buildings");
  expect_within(fault(-9.5, 24.5, 9.5), "outside buildings");
  EXPECT_EQ(fault(0, 15, 11), "");    // on the roof
  EXPECT_EQ(fault(0, 9.5, 5), "");    // in front of the wall
  EXPECT_EQ(fault(10.5, 15, 5), "");  // beside the house
  EXPECT_EQ(fault(0, -7, 6), "");
  expect_within(fault(0, -2, 3), "mounts.pole.z_m");  // above a lane
}

TEST_F(ImportedSite, has_mounts_in_yards_under_canopies_and_in_tunnels) {
  const auto is_free = [&](const Mesh& structure, const std::string& mount) {
    write("house.ply", structure.ply());
    EXPECT_NO_THROW(check_worlds(scene(mount), false));
  };
  const std::string beside = "x_m: 0, y_m: 15, z_m: 5";
  is_free(Mesh().walls(-10, 10, 10, 25, 0, 10), beside);  // a yard without a roof
  is_free(Mesh().floor(-10, 10, 10, 25, 10), beside);     // a roof without walls
  is_free(Mesh().walls(-30, 30, -4, 4, 0, 7).floor(-30, 30, -4, 4, 7), "x_m: 0, y_m: 3.9, z_m: 5");
}

LidarConfig with_table(std::vector<Vec2> directions, double rays_per_s, MotorPhase phase) {
  PatternConfig pattern;
  TableConfig& table = pattern.table.emplace();
  table.directions = std::move(directions);
  table.rays_per_s = rays_per_s;
  table.phase = phase;
  return testing::plain_lidar("own", pattern);
}

TEST(lidar_warning, of_a_free_table_that_repeats_within_a_second) {
  std::vector<Vec2> rosette, turn;
  for (int i = 0; i < 500; ++i) {
    rosette.push_back({0.3 * std::sin(0.7 * i), 0.3 * std::cos(0.9 * i)});
    turn.push_back({wrap_angle(-2 * kPi * i / 500), -0.1});
  }
  const auto warnings = [](const LidarConfig& lidar) { return lidar_warnings({&lidar, 1}).size(); };
  EXPECT_EQ(warnings(with_table(rosette, 5000, MotorPhase::kFree)), 1U);  // 0.1 s
  EXPECT_EQ(warnings(with_table(rosette, 505, MotorPhase::kFree)), 1U);   // 0.99 s
  EXPECT_EQ(warnings(with_table(rosette, 500, MotorPhase::kFree)), 0U);   // 1 s
  EXPECT_EQ(warnings(with_table(rosette, 5000, MotorPhase::kLocked)), 0U);
  EXPECT_EQ(warnings(with_table(turn, 5000, MotorPhase::kFree)), 0U);  // a spinning LiDAR
  const LidarConfig lidar = with_table(rosette, 5000, MotorPhase::kFree);
  expect_within(lidar_warnings({&lidar, 1}).front(),
                "own: pattern.table: expected a pattern without repetition for 1 s");
}

TEST(lidar_warning, of_a_beam_with_too_few_sub_rays) {
  const auto warnings = [](double width_deg, int sub_rays) {
    LidarConfig lidar = testing::plain_lidar("own", testing::spinning(1, 0, 0, 1));
    lidar.units[0].returns.beam = BeamConfig{width_deg, 0.1, sub_rays};
    return lidar_warnings({&lidar, 1});
  };
  EXPECT_EQ(warnings(0.28, 5).size(), 0U);
  EXPECT_EQ(warnings(3, 13).size(), 0U);
  ASSERT_EQ(warnings(3, 5).size(), 1U);
  expect_within(warnings(3, 5)[0],
                "own: returns.beam.sub_rays: expected 13 or more for a beam of 3 degrees, got 5");
}

}  // namespace
}  // namespace infrasim
