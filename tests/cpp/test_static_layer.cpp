#include "infrasim/pipeline/static_layer.h"

#include <gtest/gtest.h>

#include "infrasim/pipeline/simulate.h"
#include "infrasim/pipeline/static_units.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using namespace testing;

World shipped_world(const std::string& scene, const std::vector<std::string>& assignments = {},
                    const std::string& preset = "datasheet") {
  std::vector<std::string> all{"duration_s=5", "traffic.warm_up_s=20"};
  all.insert(all.end(), assignments.begin(), assignments.end());
  return build_world(read_scene(configs() / "scenes" / (scene + ".yaml"), all, preset));
}

void expect_same(const Frame& a, const Frame& b) {
  expect_equal(a.cloud, b.cloud);
  ASSERT_EQ(a.objects.size(), b.objects.size());
  for (std::size_t i = 0; i < a.objects.size(); ++i) {
    EXPECT_EQ(a.objects[i].id, b.objects[i].id);
    EXPECT_EQ(a.objects[i].points, b.objects[i].points);
    EXPECT_EQ(a.objects[i].points_in_box, b.objects[i].points_in_box);
    EXPECT_EQ(a.objects[i].visibility, b.objects[i].visibility);
  }
}

/// Checks that the frames with the layer equal the frames with all rays cast.
/// @return number of points on vehicles
int expect_same_as_casting_all(const World& world, const LidarConfig& lidar) {
  SCOPED_TRACE(world.scene.name + ", " + lidar.name + ", " + lidar.preset);
  FrameSimulator layered(world, std::array{lidar}), all(world, std::array{lidar}, {});
  int points = 0;
  for (const int k : {0, 1, 2, 3, 17, 40}) {
    const Frame a = layered.simulate(k, {true})[0], b = all.simulate(k, {true})[0];
    expect_same(a, b);
    for (const ObjectRecord& o : a.objects) points += o.points;
  }
  return points;
}

TEST(static_layer, gives_the_frames_of_casting_all) {
  for (const char* scene : {"highway", "crossroad", "curve"}) {
    for (const char* preset : {"paper", "equal", "datasheet"}) {
      const World world = shipped_world(scene, {}, preset);
      EXPECT_EQ(world.leaves.empty(), std::string(preset) != "datasheet");
      for (const char* name : {"ruby_plus", "pandar_64"})
        EXPECT_GT(
            expect_same_as_casting_all(
                world, read_lidar(configs() / "lidars" / (std::string(name) + ".yaml"), preset)),
            1000);
    }
  }
}

TEST(static_layer, of_a_pattern_that_repeats_after_nine_turns_gives_the_frames_of_casting_all) {
  const LidarConfig hdl = read_lidar(configs() / "lidars/velodyne_hdl_64e.yaml", "datasheet");
  const World world = shipped_world("crossroad");
  const auto layers = make_static_layers(world, std::array{hdl});
  EXPECT_EQ(layers[0][0]->groups(), 15625);
  expect_same_as_casting_all(world, hdl);
}

TEST(static_layer, of_channels_that_skip_columns_gives_the_frames_of_casting_all) {
  const LidarConfig ot128 = read_lidar(configs() / "lidars/hesai_ot128.yaml", "datasheet");
  const World world = shipped_world("crossroad");
  const auto layers = make_static_layers(world, std::array{ot128});
  EXPECT_EQ(layers[0][0]->groups(), 1800);
  EXPECT_GT(expect_same_as_casting_all(world, ot128), 1000);
}

TEST(static_layer, of_a_firing_cycle_repeats_after_216_turns) {
  const LidarConfig puck = read_lidar(configs() / "lidars/velodyne_vlp_16.yaml", "equal");
  const World world = shipped_world("highway");
  EXPECT_EQ(make_static_layers(world, std::array{puck}, 215)[0][0], nullptr);
  const ScanPattern pattern(puck.units[0].pattern, 0, rotation(0, 0, 0), 0);
  EXPECT_EQ(pattern.repeats_after(), 390'625);
  EXPECT_LE(2 * layer_bytes(pattern), kMostLayerBytes) << "as for the 32 channels of the VLP-32C";
}

TEST(static_layer, of_slices_gives_the_frames_of_casting_all) {
  const LidarConfig ruby = read_lidar(configs() / "lidars/ruby_plus.yaml", "equal");
  expect_same_as_casting_all(shipped_world("highway", {"aggregation=slices:7"}), ruby);
  expect_same_as_casting_all(shipped_world("highway", {"aggregation=instant"}), ruby);
}

TEST(static_layer, of_odd_numbers_of_columns_and_rings_gives_the_frames_of_casting_all) {
  PatternConfig pattern = spinning(7, -25, -1, 1);
  pattern.spinning->azimuth_step_deg.reset();
  pattern.spinning->columns_per_turn = Fraction{1001, 3};
  expect_same_as_casting_all(shipped_world("highway"), plain_lidar("odd", pattern));
}

TEST(static_layer, of_a_table_gives_the_frames_of_casting_all) {
  PatternConfig pattern;
  pattern.table.emplace().rays_per_s = 50'003;
  for (int i = 0; i < 12'345; ++i)
    pattern.table->directions.push_back({std::fmod(0.37 * i, 6.28), -0.3 + 0.0241 * (i % 13)});
  EXPECT_GT(expect_same_as_casting_all(shipped_world("highway"), plain_lidar("table", pattern)),
            100);
}

TEST(static_layer, among_leaves_gives_the_frames_of_casting_all) {
  const std::vector<std::string> leaves{
      "vegetation=[{hedge_along: {road: motorway, offset_m: 0, width_m: 2, density_per_m: 0.3}}, "
      "{trees_along: {road: motorway, offset_m: -30, every_m: 9, height_m: 12, base_m: -2}}]"};
  for (const char* name : {"velodyne_hdl_64e", "ruby_plus"})
    expect_same_as_casting_all(
        shipped_world("highway", leaves),
        read_lidar(configs() / "lidars" / (std::string(name) + ".yaml"), "datasheet"));
}

TEST(static_layer, is_left_out_where_the_pattern_never_repeats) {
  const World world = shipped_world("highway");
  const auto layers = make_static_layers(
      world, std::array{read_lidar(configs() / "lidars/livox_avia.yaml", "equal"),
                        plain_lidar("by_step", spinning(4, -20, -2, 0.7001))});
  EXPECT_EQ(layers[0][0], nullptr);
  EXPECT_EQ(layers[1][0], nullptr);
}

TEST(static_layer, of_a_step_gives_the_frames_of_casting_all) {
  const World world = shipped_world("highway");
  for (const double step_deg : {0.4, 0.7}) {
    const LidarConfig lidar = plain_lidar("step", spinning(16, -25, -1, step_deg));
    EXPECT_NE(make_static_layers(world, std::array{lidar})[0][0], nullptr);
    EXPECT_GT(expect_same_as_casting_all(world, lidar), 100);
  }
}

LidarConfig in_columns(const std::string& name, int lasers, Fraction columns_per_turn) {
  PatternConfig pattern = spinning(lasers, -25, -1, 1);
  pattern.spinning->azimuth_step_deg.reset();
  pattern.spinning->columns_per_turn = columns_per_turn;
  return plain_lidar(name, pattern);
}

TEST(static_layer, is_left_out_where_the_frames_have_fewer_rays_than_it) {
  const World world = shipped_world("highway");
  const std::array lidars{in_columns("turn", 4, {1875, 1}), in_columns("turns", 4, {1875, 4}),
                          in_columns("drift", 1, {18'000'001, 10'000})};
  const auto has = [&](std::size_t frames) {
    std::vector<bool> out;
    for (const auto& units : make_static_layers(world, lidars, frames))
      out.push_back(units[0] != nullptr);
    return out;
  };
  EXPECT_EQ(has(1), (std::vector{true, false, false}));
  EXPECT_EQ(has(4), (std::vector{true, true, false}));
  EXPECT_EQ(has(9'999), (std::vector{true, true, false}));
}

TEST(static_layer, is_left_out_where_memory_is_not_enough) {
  const World world = shipped_world("flat");
  const std::array lidars{in_columns("drift", 64, {18'000'001, 10'000})};
  EXPECT_EQ(make_static_layers(world, lidars)[0][0], nullptr);
  EXPECT_NE(error_of([&] { cast_static_layer(world, lidars[0]); }).find("bytes"),
            std::string::npos);
  // Each unit has 96 MB. Two units are within the limit, and a third is not.
  LidarConfig bundle = in_columns("bundle", 8, {1'000'001, 10'000});
  bundle.units.resize(3, bundle.units[0]);
  const std::vector<ScannerUnit> scanners = make_scanner_units(world.scene, bundle);
  EXPECT_LT(2 * layer_bytes(scanners[0].pattern), kMostLayerBytes);
  const auto layers = make_static_layers(world, std::array{bundle})[0];
  EXPECT_NE(layers[1], nullptr);
  EXPECT_EQ(layers[2], nullptr);
  EXPECT_LE(layers[0]->bytes(), layer_bytes(scanners[0].pattern));
}

TEST(static_layer, takes_no_more_than_was_reckoned_for_it) {
  const World world = shipped_world("flat");
  for (const int lasers : {1, 2, 3, 5, 7, 11, 17, 33, 129}) {
    const std::array lidars{in_columns("odd", lasers, {1001, 3})};
    const std::vector<ScannerUnit> scanners = make_scanner_units(world.scene, lidars[0]);
    EXPECT_LE(make_static_layers(world, lidars)[0][0]->bytes(), layer_bytes(scanners[0].pattern))
        << lasers;
  }
}

TEST(static_layer, of_shipped_lidars_takes_10_mb_or_less_except_for_firing_cycles) {
  const World world = shipped_world("flat");
  std::size_t all = 0;
  for (const auto& entry : std::filesystem::directory_iterator(configs() / "lidars")) {
    if (entry.path().extension() != ".yaml") continue;
    const LidarConfig lidar = read_lidar(entry.path(), "datasheet");
    const StaticLayers layers = make_static_layers(world, std::array{lidar});
    std::size_t bytes = 0;
    for (const auto& layer : layers[0]) bytes += layer ? layer->bytes() : 0;
    all += bytes;
    // These columns repeat after 9 and 216 turns.
    const auto& spinning = lidar.units.front().pattern.spinning;
    EXPECT_LT(bytes, spinning && spinning->cycle_us ? 140e6 : 10e6) << lidar.name;
  }
  EXPECT_LT(all, kMostLayerBytes) << "all LiDARs of the catalogue at one mount";
}

}  // namespace
}  // namespace infrasim
