// Tests of scenes that are read from files: surfaces (.ply) and lanes with elevation.
#include <gtest/gtest.h>

#include <random>
#include <sstream>
#include <vector>

#include "infrasim/io/ply_file.h"
#include "infrasim/pipeline/world.h"
#include "infrasim/scene/lane_file.h"
#include "infrasim/scene/mesh_file.h"
#include "infrasim/scene/region.h"
#include "infrasim/scene/site_rules.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

TEST(lane_path, is_linear_between_its_rows) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> step(0.01, 3), value(-5, 5), beyond(-4, 4);
  for (int n = 2; n < 40; ++n) {
    std::vector<CurvePoint> points{{{1e5, -2e5}, 0}};
    LanePath lane{"lane", {}, {value(random)}, {}};
    for (int i = 1; i < n; ++i) {
      points.push_back({points.back().position + Vec2{step(random), value(random)}, 0});
      lane.z.push_back(value(random));
    }
    lane.line = Curve(points);
    double from = 0;
    for (std::size_t i = 0; i + 1 < points.size(); ++i) {
      const double length = norm(points[i + 1].position - points[i].position);
      for (const double u : {0.0, 0.3, 0.999, 1.0})
        EXPECT_NEAR(lane.at(lane.z, from + u * length), lane.z[i] + u * (lane.z[i + 1] - lane.z[i]),
                    1e-9);
      from += length;
    }
    EXPECT_EQ(lane.at(lane.z, -1), lane.z.front());
    EXPECT_EQ(lane.at(lane.z, lane.line.length() + 1), lane.z.back());
  }
}

TEST(lane_path, of_ten_times_the_rows_takes_few_more_comparisons) {
  const auto comparisons = [](int rows) {
    std::vector<CurvePoint> points;
    for (int i = 0; i < rows; ++i) points.push_back({{0.5 * i, 0}, 0});
    const LanePath lane{"lane", Curve(points), std::vector<double>(points.size(), 1), {}};
    std::size_t most = 0;
    for (double s = 0; s < lane.line.length(); s += 7.3) {
      std::size_t count = 0;
      lane.at(lane.z, s, [&](double a, double b) {
        ++count;
        return a < b;
      });
      most = std::max(most, count);
    }
    return most;
  };
  EXPECT_LE(comparisons(2'000), 12U);
  EXPECT_LE(comparisons(20'000), 16U);
  EXPECT_GT(comparisons(20'000), 0U);
}

using testing::error_of;
using testing::expect_within;

class SiteFiles : public ::testing::Test {
 protected:
  std::filesystem::path write(const std::string& name, const std::string& bytes) const {
    return folder_.write(name, bytes);
  }

  /// Returns the message of reading bytes as a .ply file.
  std::string ply_error(const std::string& bytes) const {
    return error_of([&] { read_ply(write("w.ply", bytes)); });
  }

  testing::TestFolder folder_;
};

constexpr char kSquare[] =
    "ply\nformat ascii 1.0\ncomment a square\nelement vertex 4\nproperty double x\n"
    "property float y\nproperty float z\nproperty uchar red\nelement face 1\n"
    "property list uchar int vertex_indices\nend_header\n"
    "0 0 1 255\n2 0 1 255\n2 2 1 255\n0 2 1 255\n4 0 1 2 3\n";

std::string with(const std::string& from, const std::string& to) {
  std::string text = kSquare;
  return text.replace(text.find(from), from.size(), to);
}

TEST_F(SiteFiles, PolygonsOfAnAsciiFileBecomeFans) {
  const PlySurface square = read_ply(write("a.ply", kSquare));
  ASSERT_EQ(square.vertices.size(), 4U);
  EXPECT_EQ(square.vertices[2].x, 2);
  const std::vector<std::array<std::uint32_t, 3>> fan{{0, 1, 2}, {0, 2, 3}};
  EXPECT_EQ(square.triangles, fan);
}

TEST_F(SiteFiles, ABinaryFileHoldsTheSame) {
  std::ostringstream bytes;
  bytes << "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty "
           "float y\nproperty float z\nelement face 1\nproperty list uchar uint "
           "vertex_index\nend_header\n";
  const std::array<float, 9> corners{0, 0, 5, 1, 0, 5, 0, 1, 5};
  bytes.write(reinterpret_cast<const char*>(corners.data()), sizeof corners);
  bytes.put(3);
  const std::array<std::uint32_t, 3> face{2, 0, 1};
  bytes.write(reinterpret_cast<const char*>(face.data()), sizeof face);
  const PlySurface surface = read_ply(write("b.ply", bytes.str()));
  EXPECT_EQ(surface.vertices[1].z, 5);
  ASSERT_EQ(surface.triangles.size(), 1U);
  EXPECT_EQ(surface.triangles[0], face);
  const std::string whole = bytes.str();
  expect_within(ply_error(whole.substr(0, whole.size() - 3)), ": byte ");
  expect_within(ply_error(whole.substr(0, whole.size() - 3)), "the file may be truncated");
  expect_within(ply_error(whole + "x"), "got bytes after the last element");
}

TEST_F(SiteFiles, WrongSurfacesAreNamedWithTheirLine) {
  const std::vector<std::pair<std::string, std::string>> wrong{
      {"", ":1: expected a .ply, got the end of the file in its header"},
      {"solid\n", ":1: expected 'ply' in the first line, got other text"},
      {with("ascii", "binary_big_endian"),
       ":2: expected ascii, binary_little_endian, got format binary_big_endian"},
      {with("format ascii 1.0\n", ""), "got no format"},
      {with("vertex 4", "vertex 4000000000"), "got 4000000000 of 'vertex' in"},
      {with("vertex 4", "vertex -4"), ":4: expected a number as the count, got a word"},
      {with("uchar red", "colour red"),
       ":8: expected char to double, int8 to float64, got type 'colour'"},
      {with("2 2 1 255", "2 nan 1 255"),
       ":14: expected metres from the site's origin, got a vertex whose x, y or z is missing, not "
       "a number, or farther than 1000000 m from the origin"},
      {with("2 2 1 255", "2e6 2 1 255"),
       ":14: expected metres from the site's origin, got a vertex whose x, y or z is missing, not "
       "a number, or farther than 1000000 m from the origin"},
      {with("2 2 1 255", "2 two 1 255"), ":14: expected a number, got 'two'"},
      {with("4 0 1 2 3\n", "4 0 1 2 9\n"),
       ":16: expected corners that are indices of the 4 vertices before the face, counted from 0, "
       "got another number"},
      {with("4 0 1 2 3\n", "2 0 1\n"), "got a face of 2 corners"},
      {with("4 0 1 2 3\n", "4 0 1\n"), "the file may be truncated"},
      {with("4 0 1 2 3\n", "4 0 1 2 3 7\n"), "got bytes after the last element"},
      {with("vertex_indices", "corners"),
       "expected faces with vertex_indices, got a face without them"},
      {with("property double x\n", ""),
       ":11: expected metres from the site's origin, got a vertex whose x, y or z is missing, not "
       "a number, or farther than 1000000 m from the origin"},
      {with("property float y", "property double x"),
       ":6: expected each property once, got 'x' twice"},
      {with("property float y", "property int y"),
       ":6: expected float or double, got y of another type"},
      {with("uchar int vertex", "uchar float vertex"),
       ":10: expected whole numbers, got corners of type float"},
      {with("uchar int vertex", "float int vertex"),
       ":10: expected whole numbers, got a list whose length is of type float"},
      {with("element face 1", "element vertex 1"),
       ":9: expected each element once, got 'vertex' twice"},
      {with("vertex 4", "vertex 0"), ":12: expected 3 or more corners, got a face of 0 corners"},
  };
  for (const auto& [text, expected] : wrong) expect_within(ply_error(text), expected);
}

constexpr char kLanes[] =
    "lane,x,y,z,width\nup,-150,-2,-9,3.5\nup,150,-2,9,3.5\ndown,150,2,9,3\ndown,-150,2,-9,3\n";

constexpr char kSite[] =
    "name: hill\nduration_s: 1\nmounts: {pole: {x_m: 0, y_m: -7, z_m: 6}}\nlanes: lanes.csv\n"
    "meshes: [{file: road.ply, material: road}]\ntrajectories: cars.csv\n";

SceneConfig site(const testing::TestFolder& folder, const std::string& more = "") {
  SceneConfig scene = parse_scene(kSite + more, "site.yaml");
  scene.folder = folder.path();
  return scene;
}

TEST_F(SiteFiles, TheRegionOfLanesHasTheirHeightsAndEndsAroundTheFoot) {
  write("lanes.csv", kLanes);
  const EvaluationRegion region = testing::region_of(site(folder_));
  EXPECT_TRUE(region.contains({90, -2}, Class::kCar));
  EXPECT_TRUE(region.contains({90, -3.7}, Class::kCar));
  EXPECT_FALSE(region.contains({90, -3.8}, Class::kCar));
  EXPECT_TRUE(region.contains({99.8, -2}, Class::kCar));
  EXPECT_FALSE(region.contains({99.9, -2}, Class::kCar));  // the point is 100 m from the foot
  EXPECT_TRUE(region.contains({-90, 2}, Class::kCar));
  const std::string rows = region.roads_csv();
  // The lane has a slope of 6 %, and s grows in the direction of the traffic.
  expect_within(rows, "up,0,0.0000,-2.0000,0.0000,0.000000,1.7500\n");
  expect_within(rows, "up,50,50.0000,-2.0000,3.0000,0.000000,1.7500\n");
  expect_within(rows, "up,99.8749,99.8749,-2.0000,5.9925,0.000000,1.7500\n");
  expect_within(rows, "down,10,-10.0000,2.0000,-0.6000,");
}

TEST_F(SiteFiles, ALaneThatComesBackIsSeveralPartsEachWithItsOwnZero) {
  write("lanes.csv", "lane,x,y,z,width\nu,0,0,0,3\nu,200,0,0,3\nu,200,20,0,3\nu,0,20,0,3\n");
  const std::string rows = testing::region_of(site(folder_)).roads_csv();
  expect_within(rows, "\nu,0,0.0000,0.0000,");
  expect_within(rows, "\nu_2,0,0.0000,20.0000,");
  EXPECT_EQ(rows.find("u_3"), std::string::npos);
}

TEST_F(SiteFiles, ALaneThatTurnsBackOnItselfHasNoTwoRowsInOnePlaceAfterAnother) {
  write("lanes.csv", "lane,x,y,z,width\nu,0,0,0,3\nu,20.5,0,0,3\nu,0,0.001,0,3\n");
  const EvaluationRegion region = testing::region_of(site(folder_));
  EXPECT_TRUE(region.contains({15, 1}, Class::kCar));
  EXPECT_FALSE(region.contains({25, 0}, Class::kCar));
}

TEST_F(SiteFiles, ShortLanesHaveBothTheirEnds) {
  write("lanes.csv", "lane,x,y,z,width\na,3.2,0,0,3\na,3.7,0,0,3\n");
  EXPECT_EQ(testing::region_of(site(folder_)).roads_csv(),
            "road,s,x,y,z,heading,half_width\na,0,3.2000,0.0000,0.0000,0.000000,1.5000\n"
            "a,0.5,3.7000,0.0000,0.0000,0.000000,1.5000\n");
}

TEST_F(SiteFiles, RegionsNarrowIt) {
  write("lanes.csv", kLanes);
  const std::string ell =
      "regions: [{name: ell, outline_m: "
      "[[-50, -10], [50, -10], [50, 0], [0, 0], [0, 9], [-50, 9]]}]\n";
  const EvaluationRegion region = testing::region_of(site(folder_, ell));
  EXPECT_TRUE(region.contains({-40, 2}, Class::kCar));
  EXPECT_FALSE(region.contains({40, 2}, Class::kCar));  // in the hollow part of the outline
  EXPECT_TRUE(region.contains({40, -2}, Class::kCar));
  EXPECT_FALSE(region.contains({60, -2}, Class::kCar));
  EXPECT_FALSE(region.contains({40, -9}, Class::kCar));  // beside the lanes
  EXPECT_TRUE(region.regions_csv().starts_with("region,x,y\nell,-50,-10\nell,50,-10\n"));
  EXPECT_EQ(testing::region_of(site(folder_)).regions_csv(), "");
  const auto error = [&](const std::string& more) {
    return error_of([&] { testing::region_of(site(folder_, more)); });
  };
  expect_within(error("regions: [{name: far, outline_m: [[0, 50], [9, 50], [9, 60]]}]\n"),
                "site.yaml:7:11: regions.0.outline_m: expected outlines that contain the middle of "
                "a road or lane");
  expect_within(error("regions: []\n"), "regions: expected entries, got none");
  expect_within(error("regions: [{name: a, outline_m: [[0, 0], [9, 9]]}]\n"),
                "expected an outline of 3 or more corners");
  expect_within(error("regions: [{name: a, outline_m: [[0, 0], [9, 9], [5, 5]]}]\n"), "no area");
  expect_within(error("regions: [{name: \"a,b\", outline_m: [[0, 0], [9, 9], [5, 0]]}]\n"),
                "got a comma");
}

TEST_F(SiteFiles, WrongLanesAreNamedWithTheirLine) {
  const std::string head = "lane,x,y,z,width\n";
  const std::vector<std::pair<std::string, std::string>> wrong{
      {"lane,x,y\n", ":1:1: (header)"},
      {head, "expected a lane, got none"},
      {head + "a,0,0,0,3\n", "got one row of lane 'a'"},
      {head + "a,0,0,0,3\nb,0,0,0,3\nb,9,0,0,3\n", ":3:"},
      {head + "a,0,0,0,3\na,0,0,0,3\n",
       ":3:1: x: expected 0.0001 m or more from the point of the row above, got a nearer point"},
      {head + "a,0,0,0,-3\n",
       ":2:9: width: expected a number from 0.500000 to 100.000000, got '-3'"},
      {head + "a,0,nan,0,3\n",
       ":2:5: y: expected a number from -1000000.000000 to 1000000.000000, got 'nan'"},
      {head + "=a,0,0,0,3\n",
       ":2:1: lane: expected a short name that begins with a letter, a digit or _, got '=a'"},
      {head + "a,0,0,0,3\na,9,0,0,3\nb,0,0,0,3\nb,9,0,0,3\na,0,5,0,3\n", "got lane 'a' again"},
      {head + "a,900,0,0,3\na,990,0,0,3\n", "expected a lane within 100 m of the mount, got none"},
      {head + "a,0,0,0,3\na,200,0,0,3\na,200,9,0,3\na,0,9,0,3\na_2,0,3,0,3\na_2,9,3,0,3\n",
       "got 'a_2' twice"},
  };
  for (const auto& [text, expected] : wrong) {
    write("lanes.csv", text);
    expect_within(error_of([&] { testing::region_of(site(folder_)); }), expected);
  }
}

std::string standing_car() {
  std::string rows = "t,id,class,x,y,z,heading,dx,dy,dz,speed\n";
  for (int k = 0; k <= 10; ++k)
    rows += std::to_string(k / 10.0) + ",1,Car,-40,2,-1.6,0,4.5,1.9,1.6,0\n";
  return rows;
}

/// Returns the .ply text in which `corners` replaces the vertices of the square.
std::string square(const std::string& corners) {
  return with("0 0 1 255\n2 0 1 255\n2 2 1 255\n0 2 1 255\n", corners);
}

TEST_F(SiteFiles, RaysMeetTheSurfaceOfAFileAndItsMaterial) {
  write("lanes.csv", kLanes);
  write("road.ply", square("-150 -9 -9 0\n150 -9 9 0\n150 9 9 0\n-150 9 -9 0\n"));
  write("cars.csv", standing_car());
  const World world = build_world(site(folder_));
  EXPECT_EQ(world.background().class_id, (std::vector<std::uint16_t>{0, 0}));
  Raycaster raycaster = world.raycaster();
  raycaster.set_bodies({}, kUsualPeriod_s);
  RayBatch down;
  down.resize(1);
  down.dz[0] = -1;
  down.max_range = 100;
  const std::vector<std::uint32_t> order{0};
  HitBatch hits;
  raycaster.cast(down, order, hits);
  EXPECT_NEAR(hits.range[0], 6, 1e-4);
  EXPECT_NEAR(hits.cos_incidence[0], 1 / std::hypot(1, 0.06), 1e-4);
}

TEST_F(SiteFiles, MillimetresStayFarFromTheOrigin) {
  write("lanes.csv", kLanes);
  SceneConfig scene = site(folder_);
  MountConfig& mount = scene.mounts.begin()->second;
  mount.x_m = 700'000;
  mount.y_m = -900'000;
  write("road.ply",
        square("700000.123 -900000 1 0\n700009 -900000 1 0\n700009 -899991 1 0\n700000 -899991 1 "
               "0\n"));
  const TriangleMesh mesh = to_level(build_static_surface(build_site(scene)), level_pose(mount));
  EXPECT_NEAR(mesh.vertices[0][0], 0.123, 1e-5);
}

TEST_F(SiteFiles, ASensorBelowASurfaceOrInALanesWayIsRefused) {
  write("lanes.csv", kLanes);
  write("cars.csv", standing_car());
  const auto roof_at = [&](double z) {
    const std::string at = std::to_string(z) + " 0\n";
    write("road.ply", square("-9 -9 " + at + "9 -9 " + at + "9 9 " + at + "-9 9 " + at));
  };
  roof_at(7);
  expect_within(error_of([&] { build_world(site(folder_)); }),
                "got 6 below a surface of the meshes at 7 m");
  roof_at(5);
  build_world(site(folder_));
  SceneConfig scene = site(folder_);
  scene.mounts.begin()->second.y_m = -2;
  scene.mounts.begin()->second.z_m = 3;
  expect_within(
      error_of([&] { checked_site(scene); }),
      "expected 4.5 or more, or a position beside the lanes, got 3, where vehicles hit the LiDAR");
}

TEST_F(SiteFiles, NothingStandsOnALaneOfAFile) {
  write("lanes.csv", kLanes);
  const std::string house =
      "buildings: [{x_m: 50, y_m: -2, length_m: 5, width_m: 5, height_m: 9, base_m: ";
  expect_within(error_of([&] { checked_site(site(folder_, house + "0}]\n")); }), "on a lane");
  EXPECT_NO_THROW(checked_site(site(folder_, house + "7.8}]\n")));  // 4.5 m above the lane
  expect_within(
      error_of([&] { checked_site(site(folder_, "barriers: [{road: up, offset_m: 3}]\n")); }),
      "expected no name, as the scene has no roads, got unknown road 'up'");
}

TEST_F(SiteFiles, TrianglesWithoutAnAreaAreCounted) {
  write("road.ply", square("0 0 1 0\n2 0 1 0\n2 2 1 0\n2 2 1 0\n"));
  const std::vector<std::string> lines = flat_triangles(site(folder_));
  ASSERT_EQ(lines.size(), 1U);
  expect_within(lines[0], "road.ply: 1 of 2 triangles without an area");
  write("road.ply", kSquare);
  EXPECT_TRUE(flat_triangles(site(folder_)).empty());
}

TEST(SiteKeys, LanesAndRoadsOrTrafficAreRefusedTogether) {
  const std::string start =
      "name: a\nmounts: {pole: {x_m: 0, y_m: -7, z_m: 6}}\nlanes: lanes.csv\n";
  const auto error = [&](const std::string& more) {
    return error_of([&] { parse_scene(start + more, "s.yaml"); });
  };
  expect_within(error("traffic: {vehicles_per_km_lane: 5, speed: {mean_km_h: 50}, "
                      "class_shares: {Car: 1}}\n"),
                "expected trajectories with lanes of a file");
  expect_within(error("trajectories: t.csv\nroads: [{name: r, start: {x_m: 0, y_m: 0}, "
                      "centreline: [{line_m: 100}], lanes: {each_way: 1}}]\n"),
                "expected roads or lanes, got both");
  expect_within(error("trajectories: t.csv\nmeshes: [{file: a.ply, material: glass}]\n"),
                "meshes.0.material: expected road, sidewalk, terrain, structure");
}

TEST(SiteKeys, ASceneOfFilesReadsBackAsItIsDumped) {
  const std::string text =
      std::string(kSite) + "regions: [{name: a, outline_m: [[0, 0], [9, 0], [9, 9]]}]\n";
  const std::string dumped = dump_scene(parse_scene(text, "s.yaml"));
  EXPECT_EQ(dump_scene(parse_scene(dumped, "again.yaml")), dumped);
  expect_within(dumped, "lanes: \"lanes.csv\"");
}

}  // namespace
}  // namespace infrasim
