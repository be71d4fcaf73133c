#include "infrasim/scene/vegetation.h"

#include <gtest/gtest.h>

#include <numeric>
#include <ranges>

#include "infrasim/pipeline/frame_stream.h"
#include "infrasim/pipeline/simulate.h"
#include "infrasim/pipeline/vehicles.h"
#include "infrasim/raycast/volumes.h"
#include "infrasim/scene/site_rules.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using namespace testing;

constexpr auto kLeaves = static_cast<std::uint16_t>(Class::kVegetation);

LeafVolume volume(const Box3d& box, double density_per_m, bool ellipsoid = false) {
  return {box, ellipsoid, density_per_m, {}, "x_m", "a hedge"};
}

std::vector<std::uint32_t> in_order(std::size_t n) {
  std::vector<std::uint32_t> order(n);
  std::iota(order.begin(), order.end(), 0U);
  return order;
}

/// Returns n rays in one direction.
RayBatch rays_along(Vec3 d, std::size_t n) {
  RayBatch rays;
  rays.resize(n);
  rays.max_range = 200;
  std::ranges::fill(rays.dx, static_cast<float>(d.x));
  std::ranges::fill(rays.dy, static_cast<float>(d.y));
  std::ranges::fill(rays.dz, static_cast<float>(d.z));
  return rays;
}

HitBatch hits_at(float range, std::size_t n) {
  HitBatch hits;
  hits.resize(n);
  std::ranges::fill(hits.range, range);
  std::ranges::fill(hits.object, 7);
  return hits;
}

HitBatch stopped(const Volumes& volumes, const RayBatch& rays, float range = 100) {
  HitBatch hits = hits_at(range, rays.size());
  const Rng rng = Rng::of(1, "leaves");
  volumes.stop(rays, in_order(rays.size()), [&](std::uint32_t k) { return rng.at(k); }, hits);
  return hits;
}

double share_stopped(const HitBatch& hits) {
  const auto n = std::ranges::count(hits.class_id, kLeaves);
  return static_cast<double>(n) / static_cast<double>(hits.size());
}

constexpr std::size_t kRays = 40'000;
// four standard deviations of a share of this number of rays
constexpr double kWithin = 4 * 0.5 / 200;

// --- Beer-Lambert -----------------------------------------------------------------------------

TEST(vegetation, of_a_thickness_stops_the_share_of_beer_and_lambert) {
  for (const double thickness : {0.2, 1.0, 3.0}) {
    const std::array boxes{volume({20 + thickness / 2, 0, 0, thickness, 8, 2, 0}, 0.7)};
    const HitBatch hits = stopped(Volumes(boxes), rays_along({1, 0, 0}, kRays));
    EXPECT_NEAR(share_stopped(hits), 1 - std::exp(-0.7 * thickness), kWithin) << thickness;
    for (std::size_t i = 0; i < hits.size(); ++i) {
      if (hits.class_id[i] != kLeaves) continue;
      ASSERT_GE(hits.range[i], 20);
      ASSERT_LE(hits.range[i], 20 + thickness + 1e-5);
      ASSERT_EQ(hits.object[i], -1);
    }
  }
}

TEST(vegetation, stops_rays_evenly_where_it_is_thin) {
  const std::array boxes{volume({21, 0, 0, 2, 8, 2, 0}, 0.01)};
  const HitBatch hits = stopped(Volumes(boxes), rays_along({1, 0, 0}, kRays));
  double sum = 0, n = 0;
  for (std::size_t i = 0; i < hits.size(); ++i)
    if (hits.class_id[i] == kLeaves) sum += hits.range[i], ++n;
  EXPECT_NEAR(sum / n, 21, 4 * 2 / std::sqrt(12 * n));
}

TEST(vegetation, of_a_turned_hedge_is_crossed_on_the_slant) {
  const std::array boxes{volume({20, 0, 0, 40, 2, 2, rad(30)}, 0.5)};
  EXPECT_NEAR(share_stopped(stopped(Volumes(boxes), rays_along({1, 0, 0}, kRays))),
              1 - std::exp(-0.5 * 4), kWithin);
}

TEST(vegetation, of_a_crown_is_an_ellipsoid) {
  const std::array crowns{volume({20, 0, 0, 4, 4, 6, 0.3}, 0.4, true)};
  const Volumes crown(crowns);
  EXPECT_NEAR(share_stopped(stopped(crown, rays_along({1, 0, 0}, kRays))), 1 - std::exp(-0.4 * 4),
              kWithin);
  // 1 m beside the middle of a circle of 2 m radius, the chord has a length of 2 sqrt(3) m.
  const double sine = 1.0 / 20;
  const Vec3 beside{std::sqrt(1 - sine * sine), sine, 0};
  EXPECT_NEAR(share_stopped(stopped(crown, rays_along(beside, kRays))),
              1 - std::exp(-0.4 * 2 * std::sqrt(3)), kWithin);
  const Vec3 corner{20 / std::hypot(20, 1.9), 1.9 / std::hypot(20, 1.9), 0};
  const double high = 2.9 / std::hypot(20, 2.9);
  const Vec3 outside{corner.x * std::sqrt(1 - high * high), corner.y * std::sqrt(1 - high * high),
                     high};
  EXPECT_EQ(share_stopped(stopped(crown, rays_along(outside, 100))), 0);
}

TEST(vegetation, that_overlaps_adds_up) {
  const std::array boxes{volume({21, 0, 0, 2, 8, 2, 0}, 0.3), volume({22, 0, 0, 2, 8, 2, 0}, 0.2)};
  EXPECT_NEAR(share_stopped(stopped(Volumes(boxes), rays_along({1, 0, 0}, kRays))),
              1 - std::exp(-0.3 * 2 - 0.2 * 2), kWithin);
}

TEST(vegetation, around_the_sensor_and_before_a_hit_counts_up_to_it) {
  const std::array boxes{volume({0, 0, 0, 20, 20, 4, 0}, 0.1)};
  const Volumes around(boxes);
  EXPECT_NEAR(share_stopped(stopped(around, rays_along({1, 0, 0}, kRays))), 1 - std::exp(-1.0),
              kWithin);
  EXPECT_NEAR(share_stopped(stopped(around, rays_along({1, 0, 0}, kRays), 5)), 1 - std::exp(-0.5),
              kWithin);
  EXPECT_NEAR(around.transmission(1, 0, 0, 5), std::exp(-0.5), 1e-9);
  EXPECT_NEAR(around.transmission(1, 0, 0, 50), std::exp(-1.0), 1e-9);
}

TEST(vegetation, faces_rays_at_two_thirds_of_head_on) {
  const std::array boxes{volume({30, 0, 0, 20, 8, 2, 0}, 2)};
  const HitBatch hits = stopped(Volumes(boxes), rays_along({1, 0, 0}, kRays));
  const double sum = std::accumulate(hits.cos_incidence.begin(), hits.cos_incidence.end(), 0.0);
  EXPECT_EQ(share_stopped(hits), 1);
  EXPECT_NEAR(sum / kRays, 2.0 / 3, 4 * 0.24 / std::sqrt(static_cast<double>(kRays)));
}

/// Rays in all directions, and volumes between them.
struct Grove {
  RayBatch rays;
  std::vector<LeafVolume> volumes;

  Grove() {
    rays.resize(20'000);
    rays.max_range = 200;
    const Rng rng(5);
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const double azimuth = kPi * (2 * rng.at(i).uniform(0) - 1);
      const double sine = 2 * rng.at(i).uniform(1) - 1, level = std::sqrt(1 - sine * sine);
      rays.dx[i] = static_cast<float>(level * std::cos(azimuth));
      rays.dy[i] = static_cast<float>(level * std::sin(azimuth));
      rays.dz[i] = static_cast<float>(sine);
    }
    for (int i = 0; i < 70; ++i) {
      const double azimuth = 0.7 * i, away = 3 + 0.5 * i;
      volumes.push_back(volume({away * std::cos(azimuth), away * std::sin(azimuth), i % 7 - 3.0,
                                3.0 + i % 5, 2, 2.0 + i % 3, 0.3 * i},
                               0.3, i % 2 == 0));
    }
  }
};

TEST(vegetation, is_found_whatever_the_order_of_the_rays) {
  const Grove grove;
  const Volumes volumes(grove.volumes);
  const HitBatch straight = stopped(volumes, grove.rays);
  EXPECT_GT(share_stopped(straight), 0.1);
  std::vector<std::uint32_t> order = in_order(grove.rays.size());
  const Rng rng = Rng::of(1, "leaves");
  std::ranges::sort(order, {}, [&](std::uint32_t k) { return mix64(k); });
  HitBatch shuffled = hits_at(100, grove.rays.size());
  volumes.stop(grove.rays, order, [&](std::uint32_t k) { return rng.at(k); }, shuffled);
  EXPECT_EQ(straight.range, shuffled.range);
  EXPECT_EQ(straight.cos_incidence, shuffled.cos_incidence);
  // The rays are cast one by one, so that no packet hides a volume from a ray.
  HitBatch single = hits_at(100, grove.rays.size());
  for (const std::uint32_t k : order)
    volumes.stop(grove.rays, std::array{k}, [&](std::uint32_t i) { return rng.at(i); }, single);
  EXPECT_EQ(straight.range, single.range);
}

// --- frames -----------------------------------------------------------------------------------

/// Returns a LiDAR that detects everything up to 200 m.
LidarConfig seeing_lidar(const std::string& name = "seeing") {
  LidarConfig lidar = plain_lidar(name, spinning(16, -15, 15, 1));
  lidar.units[0].returns.detection.emplace().range_at_10_percent_m = 2000;
  return lidar;
}

VegetationConfig hedge_across(double x_m, double width_m = 4) {
  VegetationConfig v;
  v.hedge = HedgeConfig{.x_m = x_m,
                        .y_m = 20,
                        .length_m = 20,
                        .width_m = width_m,
                        .height_m = 8,
                        .heading_deg = 0,
                        .base_m = 0,
                        .density_per_m = 1,
                        .place = {}};
  return v;
}

VegetationConfig tree_at(double x_m, double y_m) {
  VegetationConfig v;
  v.tree = TreeConfig{.x_m = x_m, .y_m = y_m, .shape = {}, .place = {}};
  return v;
}

Frame frame_of(const SceneConfig& scene, const LidarConfig& lidar, int k = 0) {
  const World world = build_world(scene);
  return FrameSimulator(world, std::array{lidar}).simulate(k, {true})[0];
}

TEST(vegetation, becomes_points_of_its_class_inside_it_that_move_from_frame_to_frame) {
  SceneConfig scene = empty_road();
  scene.vegetation = {hedge_across(0)};
  const Frame first = frame_of(scene, seeing_lidar()), second = frame_of(scene, seeing_lidar(), 1);
  // The hedge is in the levelled frame, whose origin is 6 m above the road.
  const LeafVolume hedge = volume({0, 20, 4 - 6, 20.01, 4.01, 8.01, 0}, 1);
  int points = 0;
  for (std::size_t i = 0; i < first.cloud.size(); ++i) {
    if (first.cloud.class_id[i] != kLeaves) continue;
    ++points;
    EXPECT_TRUE(holds(hedge, point(first.cloud, i)));
    EXPECT_LE(first.cloud.intensity[i], 0.55F);
    EXPECT_EQ(first.cloud.object_id[i], -1);
  }
  EXPECT_GT(points, 300);
  EXPECT_GT(std::ranges::count_if(std::views::iota(0UL, first.cloud.size()),
                                  [&](std::size_t i) {
                                    return first.cloud.class_id[i] == kLeaves &&
                                           point(first.cloud, i).z > 0;
                                  }),
            30);  // points above all solid objects
  EXPECT_NE(first.cloud.xyz, second.cloud.xyz);
}

TEST(vegetation, has_solid_trunks_below_crowns) {
  SceneConfig scene = empty_road();
  scene.vegetation = {tree_at(12, 12)};
  const Frame frame = frame_of(scene, seeing_lidar());
  int wood = 0, leaves = 0;
  for (std::size_t i = 0; i < frame.cloud.size(); ++i) {
    const Vec3 p = point(frame.cloud, i);
    if (frame.cloud.class_id[i] == static_cast<std::uint16_t>(Class::kStructure)) {
      ++wood;
      EXPECT_LT(std::hypot(p.x - 12, p.y - 12), 0.3);
    }
    if (frame.cloud.class_id[i] != kLeaves) continue;
    ++leaves;
    EXPECT_LE(std::hypot(p.x - 12, p.y - 12), 2.5);
    EXPECT_GE(p.z, 3 - 6);
    EXPECT_LE(p.z, 9 - 6);
  }
  EXPECT_GT(wood, 0);
  EXPECT_GT(leaves, 30);
}

TEST(vegetation, of_a_row_stands_along_its_road) {
  SceneConfig scene = empty_road();
  VegetationConfig trees, hedge;
  trees.trees_along = TreesAlongConfig{.road = "road",
                                       .offset_m = 8,
                                       .every_m = 10,
                                       .from_m = 100,
                                       .to_m = 145,
                                       .shape = {},
                                       .place = {}};
  hedge.hedge_along = HedgeAlongConfig{.road = "road",
                                       .offset_m = -6,
                                       .height_m = 1,
                                       .width_m = 1,
                                       .base_m = 0.5,
                                       .from_m = 50,
                                       .to_m = 75,
                                       .density_per_m = 2,
                                       .place = {}};
  scene.vegetation = {hedge, trees};
  ASSERT_EQ(trunks(scene, centrelines(scene)).size(), 5U);
  EXPECT_NEAR(trunks(scene, centrelines(scene))[4].box.x, -60, 1e-9);
  EXPECT_NEAR(trunks(scene, centrelines(scene))[4].box.y, 8, 1e-9);
  const std::vector<LeafVolume> volumes = leaf_volumes(scene, centrelines(scene));
  ASSERT_EQ(volumes.size(), 7U);
  EXPECT_NEAR(volumes[1].box.x, -127.5, 1e-9);
  EXPECT_NEAR(volumes[1].box.dx, 5, 1e-9);
  EXPECT_NEAR(volumes[1].box.z, 1, 1e-9);
  scene.vegetation[0].hedge_along->road = "none";
  EXPECT_NE(error_of([&] { build_world(scene); }).find("got unknown road 'none'"),
            std::string::npos);
}

TEST(vegetation, is_nothing_to_lidars_that_detect_whatever_they_hit) {
  SceneConfig scene = empty_road();
  scene.ground.push_back(ground_at(-0.5));
  const LidarConfig plain = plain_lidar("plain", spinning(16, -15, 15, 1));
  const Frame bare = frame_of(scene, plain);
  scene.vegetation = {hedge_across(0)};
  expect_equal(frame_of(scene, plain).cloud, bare.cloud);
}

TEST(vegetation, out_of_the_way_changes_nothing_and_an_empty_list_is_none) {
  SceneConfig scene = empty_road();
  scene.ground.push_back(ground_at(-0.5));
  const Frame bare = frame_of(scene, seeing_lidar());
  scene.vegetation = {hedge_across(0)};
  scene.vegetation[0].hedge->base_m = -20;  // below the ground
  scene.vegetation[0].hedge->height_m = 10;
  expect_equal(frame_of(scene, seeing_lidar()).cloud, bare.cloud);
  EXPECT_TRUE(build_world(empty_road()).leaves.empty());
}

TEST(vegetation, gives_a_lidar_the_same_points_alone_and_among_others) {
  SceneConfig scene = empty_road();
  scene.vegetation = {hedge_across(0), tree_at(12, -12)};
  const World world = build_world(scene);
  const std::array both{seeing_lidar("other"), seeing_lidar()};
  const auto frames = FrameSimulator(world, both).simulate(2, {true, true});
  expect_equal(frames[1].cloud, frame_of(scene, seeing_lidar(), 2).cloud);
  EXPECT_NE(frames[0].cloud.xyz, frames[1].cloud.xyz);  // random samples depend on the LiDAR
}

TEST(vegetation, is_met_by_beams_above_all_that_is_solid) {
  SceneConfig scene = empty_road();
  scene.vegetation = {hedge_across(0)};
  LidarConfig wide = seeing_lidar();
  wide.units[0].returns.beam =
      BeamConfig{.vertical_deg = 0.3, .horizontal_deg = 0.03, .where = BeamWhere::kEverywhere};
  const Frame frame = frame_of(scene, wide);
  int above = 0;
  for (std::size_t i = 0; i < frame.cloud.size(); ++i)
    above += frame.cloud.class_id[i] == kLeaves && point(frame.cloud, i).z > 0 ? 1 : 0;
  EXPECT_GT(above, 30);
}

TEST(vegetation, hides_vehicles_by_its_mean) {
  SceneConfig scene = empty_road();
  // 2 m of leaves that stop a ray with a probability of 1 per metre
  scene.vegetation = {hedge_across(0, 2)};
  scene.vegetation[0].hedge->length_m = 100;
  const TestFolder folder;
  const auto visibility = [&](const SceneConfig& s) {
    World world = build_world(s);
    world.trajectories =
        std::make_shared<const Trajectories>(straight_on({car_on_road(1, 0, 40, 0)}, 2));
    Raycaster raycaster = world.raycaster();
    FrameVehicles vehicles = set_vehicles(world, 0, kUsualPeriod_s, 200, raycaster);
    return raycaster.visibility(0, world.leaves);
  };
  EXPECT_EQ(visibility(empty_road()), 1);
  // Rays look down by 8 degrees at most, so their paths through the hedge are up to 1 % longer than
  // 2 m.
  EXPECT_NEAR(visibility(scene), std::exp(-2.0), 0.01);
}

// --- sites ------------------------------------------------------------------------------------

TEST(vegetation, on_a_lane_is_refused) {
  const auto error = [](const VegetationConfig& v) {
    SceneConfig scene = empty_road();
    scene.vegetation = {v};
    return error_of([&] { checked_site(scene); });
  };
  VegetationConfig hedge = hedge_across(0);
  hedge.hedge->y_m = 4;
  EXPECT_NE(error(hedge).find("got a hedge on a lane"), std::string::npos);
  EXPECT_NE(error(tree_at(50, 2)).find("got an object on a lane"), std::string::npos);
  EXPECT_NE(error(tree_at(50, 5)).find("got a crown on a lane"), std::string::npos);
  VegetationConfig high = tree_at(50, 5);
  high.tree->shape.trunk_m = 4.5;
  SceneConfig scene = empty_road();
  scene.vegetation = {high};
  checked_site(scene);
}

TEST(vegetation, around_a_sensor_is_refused) {
  SceneConfig scene = empty_road();
  scene.mounts["pole"].y_m = 10;
  scene.vegetation = {tree_at(1, 10)};
  EXPECT_NE(error_of([&] { checked_site(scene); }).find("inside a crown"), std::string::npos);
  scene.vegetation = {hedge_across(0)};
  scene.vegetation[0].hedge->y_m = 10;
  EXPECT_NE(error_of([&] { checked_site(scene); }).find("inside a hedge"), std::string::npos);
}

// --- presets ----------------------------------------------------------------------------------

constexpr const char* kWithPresets = R"(name: green
duration_s: 1
mounts: {pole: {x_m: 0, y_m: 0, z_m: 6}}
roads:
  - name: road
    start: {x_m: -100, y_m: 0}
    centreline: [{line_m: 200}]
    lanes: {each_way: 1}
weather: {rain_mm_per_h: 1, visibility_m: 400}
traffic: {vehicles_per_km_lane: 0, speed: {mean_km_h: 50}, class_shares: {Car: 1}}
presets:
  datasheet:
    weather: {rain_mm_per_h: 3}
    vegetation:
      - hedge_along: {road: road, offset_m: 8}
      - tree: {x_m: 20, y_m: 20}
  night: {weather: {sunlight_klux: 0}}
)";

TEST(scene_presets, hold_on_top_of_the_other_keys_where_the_lidars_use_them) {
  const TestFolder folder;
  const auto file = folder.write("green.yaml", kWithPresets);
  const SceneConfig green = read_scene(file, {}, "datasheet"),
                    plain = read_scene(file, {}, "paper");
  EXPECT_EQ(green.vegetation.size(), 2U);
  EXPECT_EQ(green.weather.rain_mm_per_h, 3);
  EXPECT_EQ(green.weather.visibility_m, 400);
  EXPECT_TRUE(plain.vegetation.empty());
  EXPECT_EQ(plain.weather.rain_mm_per_h, 1);
  EXPECT_EQ(read_scene(file, {}, "night").weather.sunlight_klux, 0);
  EXPECT_EQ(plain.preset_blocks, (std::vector<std::string>{"datasheet", "night"}));
}

TEST(scene_presets, are_resolved_in_a_dump_and_below_assignments) {
  const TestFolder folder;
  const auto file = folder.write("green.yaml", kWithPresets);
  const std::string dumped = dump_scene(read_scene(file, {}, "datasheet"));
  EXPECT_EQ(dumped.find("presets"), std::string::npos);
  EXPECT_EQ(dump_scene(parse_scene(dumped, "dump")), dumped);
  EXPECT_NE(dumped.find("density_per_m: 1.5"), std::string::npos);
  const std::array none{std::string("vegetation=[]"), std::string("weather.rain_mm_per_h=9")};
  const SceneConfig set = read_scene(file, none, "datasheet");
  EXPECT_TRUE(set.vegetation.empty());
  EXPECT_EQ(set.weather.rain_mm_per_h, 9);
}

TEST(scene_presets, are_wrong_at_file_line_and_key) {
  const auto error = [](const std::string& part, const std::string& by, int line,
                        const std::string& key, const std::string& what) {
    const TestFolder folder;
    std::string text = kWithPresets;
    text.replace(text.find(part), part.size(), by);
    const auto file = folder.write("green.yaml", text);
    expect_message(error_of([&] { build_world(read_scene(file, {}, "datasheet")); }), file, line,
                   key, what);
  };
  error("rain_mm_per_h: 3", "rain: 3", 13, "weather.rain", "unknown key");
  error("- tree: {", "- tree: {height_m: 2, ", 16, "vegetation.1.tree.height_m", "above trunk_m");
  error("x_m: 20, y_m: 20", "x_m: 20, y_m: 1", 16, "x_m", "got an object on a lane");
  error("- tree: {x_m: 20, y_m: 20}", "- {}", 16, "vegetation.1.hedge", "one of hedge");
  error("night: {weather: {sunlight_klux: 0}}", "night: 5", 17, "presets.night", "expected a map");
  error("night: {weather: {sunlight_klux: 0}}", "datasheet: {}", 17, "datasheet", "got it twice");
}

TEST(scene_presets, refuse_lidars_of_another_preset) {
  const TestFolder folder;
  const auto file = folder.write("green.yaml", kWithPresets);
  const World world = build_world(read_scene(file, {}, "datasheet"));
  LidarConfig lidar = seeing_lidar();
  lidar.preset = "paper";
  EXPECT_NE(error_of([&] { FrameStream(world, {lidar}, {0}, 1); }).find("seeing: preset: expected"),
            std::string::npos);
  lidar.preset = "datasheet";
  EXPECT_TRUE(FrameStream(world, {lidar}, {0}, 1).next().has_value());
}

}  // namespace
}  // namespace infrasim
