#include "infrasim/scene/profile.h"

#include <gtest/gtest.h>

#include <array>
#include <map>
#include <sstream>

#include "infrasim/pipeline/scene_filters.h"
#include "infrasim/pipeline/simulate.h"
#include "infrasim/scene/sensor_rules.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::plain_lidar;
using testing::spinning;

constexpr const char* kPlain = R"(
name: plain
duration_s: 5
mounts: {pole: {x_m: 0, y_m: -9, z_m: 8}}
roads:
  - name: main
    start: {x_m: -250, y_m: 0}
    centreline: [{line_m: 500}]
    lanes: {each_way: 2, shoulder_m: 1, sidewalk_m: 2}
ground: [{elevation_m: -0.1, outline_m: [[-300, -100], [300, -90], [310, 100], [-300, 100]]}]
buildings: [{x_m: 60, y_m: 25, base_m: -0.1, length_m: 20, width_m: 12, height_m: 8}]
barriers: [{road: main, offset_m: 10.5, height_m: 0.8}]
vegetation: [{hedge_along: {road: main, offset_m: -12, from_m: 260, to_m: 400}}]
parked: [{road: main, offset_m: -9.2, from_m: 260, to_m: 320, class_shares: {Car: 1}}]
people: [{road: main, offset_m: 8.9, per_km: 40, class: Pedestrian, speed: {mean_km_h: 5, std_km_h: 1}}]
traffic: {vehicles_per_km_lane: 20, speed: {mean_km_h: 50, std_km_h: 3}, class_shares: {Car: 0.8, Bus: 0.2}}
)";
constexpr const char* kCrest =
    "profile: {points_m: [[-100, -6], [0, 0], [100, -4]], vertical_curve_m: 60}\n";

SceneConfig plain() { return parse_scene(kPlain, "plain"); }
SceneConfig crest() { return parse_scene(std::string(kPlain) + kCrest, "crest"); }

TEST(profile, runs_straight_from_point_to_point_and_level_beyond) {
  const Profile profile(crest());
  EXPECT_EQ(Profile(plain()).rise({17, 3}), 0);
  for (const auto& [x, z] : std::map<double, double>{
           {-5000, -6}, {-130, -6}, {-50, -3}, {-30, -1.8}, {50, -2}, {130, -4}, {5000, -4}})
    EXPECT_NEAR(profile.rise({x, 55}), z, 1e-9) << x;
}

TEST(profile, a_parabola_rounds_each_change_of_grade) {
  const Profile profile(crest());
  // change of grade times length, divided by eight
  EXPECT_NEAR(profile.rise({0, 0}), -0.10 * 60 / 8, 1e-9);
  for (double x = -29; x <= 29; x += 1) {
    const double bend =
        profile.rise({x + 1, 0}) - 2 * profile.rise({x, 0}) + profile.rise({x - 1, 0});
    EXPECT_NEAR(bend, -0.10 / 60, 1e-9) << x;
  }
}

TEST(profile, stations_run_along_the_heading_from_the_origin) {
  const std::string turned =
      "profile: {x_m: 10, y_m: 20, heading_deg: 90, points_m: [[0, 1], [100, 11]]}\n";
  const Profile profile(parse_scene(std::string(kPlain) + turned, "turned"));
  EXPECT_NEAR(profile.rise({-300, 70}), 6, 1e-9);
}

/// Horizontal area of a class, and the largest deviation of a triangle from the profile.
struct Draped {
  double area_m2 = 0;
  double off_m = 0;
};

Draped draped(const SceneConfig& scene, Class material, double base_m) {
  const Profile profile(scene);
  const TriangleMesh mesh = to_level(build_static_surface(build_site(scene)), {});
  Draped out;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (mesh.class_id[i] != static_cast<std::uint16_t>(material)) continue;
    std::array<Vec3, 3> p;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto& v = mesh.vertices[mesh.triangles[i][k]];
      p.at(k) = {v[0], v[1], v[2]};
    }
    const Vec3 one = p[1] - p[0], other = p[2] - p[0];
    out.area_m2 += std::abs(cross(one, other).z) / 2;
    for (double u = 0; u <= 1; u += 1.0 / 16)
      for (double v = 0; u + v <= 1; v += 1.0 / 16) {
        const Vec3 at = p[0] + u * one + v * other;
        out.off_m = std::max(out.off_m, std::abs(at.z - base_m - profile.rise({at.x, at.y})));
      }
  }
  return out;
}

TEST(profile, surfaces_are_cut_and_lie_on_it) {
  for (const auto& [material, base_m] : std::map<Class, double>{
           {Class::kRoad, 0}, {Class::kSidewalk, -0.01}, {Class::kTerrain, -0.1}}) {
    const Draped level = draped(plain(), material, base_m),
                 lifted = draped(crest(), material, base_m);
    EXPECT_NEAR(lifted.area_m2, level.area_m2, 1e-3 * level.area_m2);
    EXPECT_LT(lifted.off_m, 0.0101);  // a centimetre plus rounding in single precision
  }
  EXPECT_LT(to_level(build_static_surface(build_site(crest())), {}).triangles.size(), 15000);
}

TEST(profile, cutting_ends_where_curves_touch_are_short_or_lie_aslant) {
  for (const char* shape : {"points_m: [[-60, 0], [0, 3.6], [60, 0]], vertical_curve_m: 60",
                            "points_m: [[-60, 0], [0, 8.9], [60, 0]], vertical_curve_m: 1"})
    for (const int heading_deg : {0, 40, 90, -135}) {
      const std::string profile =
          "profile: {heading_deg: " + std::to_string(heading_deg) + ", " + shape + "}\n";
      SceneConfig scene = parse_scene(std::string(kPlain) + profile, "slanted");
      scene.ground[0].outline_m = {{-200, -200}, {200, -200}, {200, 200}, {-200, 200}};
      EXPECT_LT(to_level(build_static_surface(build_site(scene)), {}).triangles.size(), 100000)
          << profile;
      EXPECT_LT(draped(scene, Class::kTerrain, -0.1).off_m, 0.0101) << profile;
    }
}

TEST(profile, lifts_a_hedge_by_its_centre_from_end_to_end) {
  const std::string hedge =
      "vegetation: [{hedge: {x_m: 5, y_m: 30, length_m: 60, width_m: 5, height_m: 2, "
      "heading_deg: 30, base_m: 0.2}}]\n";
  std::string text = kPlain;
  const auto line = text.find("vegetation:");
  text.replace(line, text.find('\n', line) + 1 - line, hedge);
  const SceneConfig scene = parse_scene(text + kCrest, "hedge");
  const Profile profile(scene);
  const World world = build_world(scene);
  LidarConfig lidar = plain_lidar("seeing", spinning(128, -25, 5, 0.1));
  lidar.units[0].returns.detection.emplace().range_at_10_percent_m = 2000;
  const Frame frame = FrameSimulator(world, std::array{lidar}).simulate(3, {true}).front();
  const Vec2 along = heading_vector(rad(30));
  double first = 0, last = 0, low = kInf, high = -kInf;
  for (std::size_t i = 0; i < frame.cloud.size(); ++i) {
    if (frame.cloud.class_id[i] != static_cast<std::uint16_t>(Class::kVegetation)) continue;
    const Vec3 p = testing::point(frame.cloud, i);
    const Vec2 place{p.x, p.y - 9};
    first = std::min(first, dot(place - Vec2{5, 30}, along));
    last = std::max(last, dot(place - Vec2{5, 30}, along));
    low = std::min(low, p.z + 8 - profile.rise(place));
    high = std::max(high, p.z + 8 - profile.rise(place));
  }
  EXPECT_NEAR(first, -30, 0.5);
  EXPECT_NEAR(last, 30, 0.5);
  EXPECT_NEAR(low, 0.2, 0.15);  // pieces of 2 m on a grade of 6 %
  EXPECT_NEAR(high, 2.2, 0.15);
}

TEST(profile, a_height_above_the_road_is_that_above_the_road_there) {
  SceneConfig scene = crest();
  scene.mounts["pole"].x_m = -110;
  scene.mounts["pole"].z_m = 2;
  scene.filters = {{GroundPlane{}}};
  const auto none = [](int) { return std::vector<float>{}; };
  const FilterStep step =
      make_filters(build_site(scene), scene.mounts.begin()->second, none).front();
  EXPECT_NEAR(std::get<GroundPlane>(step).sensor_height_m, 7.8, 1e-9);
}

TEST(ground_plane, without_a_height_needs_a_mount_above_the_first_road) {
  SceneConfig scene = testing::empty_road();
  RoadConfig high = scene.roads.front();
  high.name = "high";
  high.start.y_m = 100;
  high.elevation_m = 8;
  scene.roads.insert(scene.roads.begin(), high);
  scene.filters = {{GroundHeight{-5}}, {GroundPlane{}}};
  const std::string message = testing::error_of([&] { build_world(scene); });
  testing::expect_within(message, "filters.1.ground_plane.sensor_height_m: expected the height");
  testing::expect_within(message, "mount 'pole'");
  EXPECT_EQ(testing::error_of([&] { check_worlds(scene, false); }), message);
  scene.filters = {{GroundPlane{.sensor_height_m = 6}}};
  EXPECT_NO_THROW(build_world(scene));
}

TEST(profile, a_sensor_beside_a_vehicle_that_leans_is_not_in_it) {
  SceneConfig scene = plain();
  scene.mounts["pole"].x_m = 5;
  scene.mounts["pole"].y_m = 0;
  scene.mounts["pole"].z_m = 2.2;
  ObjectState bus = testing::car_on_road(1, 0, 0, 0);
  bus.box.dx = 12, bus.box.dz = 3, bus.box.z = 1.6;
  std::vector<ObjectState> states{bus};
  EXPECT_THROW(check_sensor_is_free(scene, states, 0), ConfigError);
  states[0].box.pitch = std::atan(0.15);  // downhill: the nose is 0.7 m lower
  EXPECT_THROW(check_sensor_is_free(scene, states, 0), ConfigError);
  scene.mounts["pole"].z_m = 2.9;
  EXPECT_NO_THROW(check_sensor_is_free(scene, states, 0));
}

TEST(profile, neighbours_are_cut_alike_so_that_no_ray_falls_through) {
  const TriangleMesh mesh = to_level(build_static_surface(build_site(crest())), {});
  std::map<std::pair<std::array<float, 3>, std::array<float, 3>>, int> sides;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (mesh.class_id[i] != static_cast<std::uint16_t>(Class::kTerrain)) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      auto a = mesh.vertices[mesh.triangles[i][k]],
           b = mesh.vertices[mesh.triangles[i][(k + 1) % 3]];
      sides[std::minmax(a, b)] += 1;
    }
  }
  int alone = 0;
  for (const auto& [side, count] : sides) alone += count == 1;
  for (const auto& [side, count] : sides) {
    if (count != 1) continue;  // an edge of only one triangle is part of the outline
    const auto& [a, b] = side;
    const Vec2 d{b[0] - a[0], b[1] - a[1]};
    double nearest = kInf;
    for (const auto& [from, to] : std::vector<std::pair<Vec2, Vec2>>{{{-300, -100}, {300, -90}},
                                                                     {{300, -90}, {310, 100}},
                                                                     {{310, 100}, {-300, 100}},
                                                                     {{-300, 100}, {-300, -100}}}) {
      const Vec2 edge = to - from;
      nearest = std::min(
          nearest,
          (std::abs(cross(Vec2{a[0], a[1]} - from, edge)) + std::abs(cross(d, edge))) / norm(edge));
    }
    EXPECT_LT(nearest, 0.01);
  }
  EXPECT_GT(alone, 4);
}

TEST(profile, vehicles_stand_on_their_wheels_and_people_upright) {
  const Profile profile(crest());
  const World level = build_world(plain()), world = build_world(crest());
  ASSERT_EQ(level.trajectories->rows.size(), world.trajectories->rows.size());
  double steepest = 0;
  for (std::size_t k = 0; k < world.trajectories->rows.size(); ++k)
    for (std::size_t i = 0; i < world.trajectories->rows[k].size(); ++i) {
      const ObjectState &flat = level.trajectories->rows[k][i], &s = world.trajectories->rows[k][i];
      ASSERT_EQ(flat.id, s.id);
      if (s.object_class == Class::kPedestrian) {
        EXPECT_EQ(s.box.pitch, 0);
        EXPECT_NEAR(s.box.z, flat.box.z + profile.rise({s.box.x, s.box.y}), 1e-3);
        continue;
      }
      for (const double end : {-0.3, 0.3}) {
        const Vec3 wheel = BoxFrame(s.box).from_box({end * s.box.dx, 0, -s.box.dz / 2});
        EXPECT_NEAR(wheel.z, profile.rise({wheel.x, wheel.y}), 0.01);
      }
      EXPECT_NEAR(s.box.x, flat.box.x, 0.15);
      steepest = std::max(steepest, std::abs(s.box.pitch));
    }
  EXPECT_NEAR(steepest, std::atan(0.06), 1e-3);
}

TEST(profile, points_of_vehicles_lie_in_their_boxes_and_those_of_the_road_on_it) {
  SceneConfig scene = crest();
  scene.people.reset();
  const World world = build_world(scene);
  const std::array lidars{plain_lidar("turning", spinning(128, -25, 5, 0.1))};
  const Frame frame = FrameSimulator(world, lidars).simulate(3, {true}).front();
  EXPECT_TRUE(frame.pitched);
  const Profile profile(scene);
  int roads = 0, vehicles = 0;
  for (std::size_t i = 0; i < frame.cloud.size(); ++i) {
    const Vec3 p{frame.cloud.xyz[3 * i], frame.cloud.xyz[3 * i + 1], frame.cloud.xyz[3 * i + 2]};
    vehicles += frame.cloud.object_id[i] >= 0;
    if (frame.cloud.class_id[i] != static_cast<std::uint16_t>(Class::kRoad)) continue;
    EXPECT_NEAR(p.z + 8, profile.rise({p.x, p.y - 9}), 0.02);
    ++roads;
  }
  EXPECT_GT(roads, 1000);
  EXPECT_GT(vehicles, 500);
}

TEST(profile, the_regions_roads_have_its_heights) {
  std::istringstream rows(testing::region_of(crest()).roads_csv());
  const Profile profile(crest());
  std::string line;
  std::getline(rows, line);
  int n = 0;
  for (; std::getline(rows, line); ++n) {
    std::istringstream cells(line.substr(line.find(',') + 1));
    std::array<double, 4> sxyz{};
    for (double& value : sxyz) {
      std::string cell;
      std::getline(cells, cell, ',');
      value = std::stod(cell);
    }
    EXPECT_NEAR(sxyz[3], profile.rise({sxyz[1], sxyz[2]}), 1e-4);
  }
  EXPECT_EQ(n, 201);
}

TEST(profile, a_sensor_on_a_slope_is_judged_by_the_slope_under_it) {
  const auto build_at = [](double x_m, double z_m) {
    SceneConfig scene = crest();
    scene.parked.reset();
    scene.mounts["pole"].x_m = x_m;
    scene.mounts["pole"].z_m = z_m;
    build_world(scene);
  };
  EXPECT_NO_THROW(build_at(-110, -1));
  EXPECT_NE(testing::error_of([&] { build_at(0, -0.9); }).find("got -0.9 below"),
            std::string::npos);
}

}  // namespace
}  // namespace infrasim
