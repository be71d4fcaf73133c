#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/config/lidar_tables.h"
#include "infrasim/config/scene_config.h"
#include "infrasim/config/tree.h"
#include "infrasim/io/npy.h"
#include "infrasim/simulate.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::configs;
using testing::error_of;
using testing::expect_message;
using testing::TestFolder;

// --- a scene and its errors -------------------------------------------------------------------

const std::string kScene = R"(seed: 1
name: crossing
duration_s: 1
aggregation: slices:10
detail: mid
fields: false
mounts:
  pole: {x_m: 5, y_m: -9, z_m: 6}
weather: {rain_mm_per_h: 5, visibility_m: 500}
roads:
  - name: main
    start: {x_m: -100, y_m: 0}
    centreline:
      - line_m: 200
    lanes: {each_way: 1, width_m: 3.5, median_m: 1}
  - name: side
    start: {x_m: 0, y_m: -100, heading_deg: 90}
    centreline:
      - {line_m: 50}
      - {radius_m: 400, turn_deg: 20}
    lanes: {each_way: 2, shoulder_m: 0.5}
    embankment: {foot_elevation_m: -3}
ground:
  - elevation_m: -1
    outline_m: [[-200, -200], [200, -200], [200, 200], [-200, 200]]
buildings:
  - {x_m: 50, y_m: 50, length_m: 10, width_m: 10, height_m: 5}
barriers:
  - {road: main, offset_m: 8, from_m: 10, to_m: 60}
gantries:
  - {road: main, s_m: 30}
junctions:
  - roads: [main, side]
    signal: {green_s: 10, all_red_s: 2}
traffic:
  vehicles_per_km_lane: 10
  speed: {mean_km_h: 50}
  warm_up_s: 1
  class_shares: {Car: 0.8, Bus: 0.2}
)";

std::string replaced(std::string text, const std::string& part, const std::string& by) {
  const auto at = text.find(part);
  if (at == std::string::npos) throw std::logic_error("no '" + part + "' in the text");
  return text.replace(at, part.size(), by);
}

/// Line of the text that a comment `#!` marks.
int marked_line(const std::string& text) {
  const auto mark = text.find("#!");
  if (mark == std::string::npos) throw std::logic_error("no line is marked");
  return 1 + static_cast<int>(std::count(text.begin(), text.begin() + static_cast<long>(mark), '\n'));
}

/// With `part` replaced, the scene is wrong on the line that ends in `#!`.
void expect_scene_error(const std::string& part, const std::string& by, const std::string& key,
                        const std::string& what) {
  SCOPED_TRACE(by);
  const TestFolder folder;
  const std::string text = replaced(kScene, part, by);
  const auto file = folder.write("scene.yaml", text);
  expect_message(error_of([&] { build_world(read_scene(file)); }), file, marked_line(text), key,
                 what);
}

TEST(scene_file, with_every_key_is_read) {
  const TestFolder folder;
  const SceneConfig scene = read_scene(folder.write("scene.yaml", kScene));
  EXPECT_EQ(scene.name, "crossing");
  EXPECT_EQ(scene.detail, Detail::kMid);
  EXPECT_EQ(scene.mounts.at("pole").y_m, -9);
  EXPECT_EQ(scene.weather.visibility_m, 500);
  EXPECT_EQ(scene.roads.at(1).centreline.at(1).radius_m, 400);
  EXPECT_EQ(scene.traffic->class_shares.at("Bus"), 0.2);
  EXPECT_NO_THROW(build_world(scene));
}

TEST(scene_file, defaults_stand_for_absent_keys) {
  const TestFolder folder;
  const SceneConfig scene = read_scene(folder.write("scene.yaml", kScene));
  EXPECT_EQ(scene.region_half_length_m, SceneConfig{}.region_half_length_m);
  EXPECT_EQ(scene.roads.at(1).lanes.width_m, LanesConfig{}.width_m);
}

TEST(scene_file, an_unknown_key_is_an_error_that_names_the_allowed_ones) {
  expect_scene_error("duration_s: 1", "duration: 1 #!", "duration", "duration_s");
  expect_scene_error("{rain_mm_per_h: 5", "{rain: 5 #!\n", "weather.rain", "rain_mm_per_h");
  expect_scene_error("- line_m: 200", "- length_m: 200 #!", "roads.0.centreline.0", "line_m");
}

TEST(scene_file, a_key_twice_is_an_error) {
  expect_scene_error("duration_s: 1", "duration_s: 1\nduration_s: 1 #!", "duration_s", "twice");
}

TEST(scene_file, a_missing_key_is_an_error) {
  expect_scene_error("seed: 1\nname: crossing", "seed: 1 #!", "name", "required");
  expect_scene_error("{x_m: 5, y_m: -9, z_m: 6}", "{x_m: 5, y_m: -9} #!", "mounts.pole.z_m",
                     "required");
  expect_scene_error("- {road: main, s_m: 30}", "- {s_m: 30} #!", "gantries.0.road", "required");
}

TEST(scene_file, a_wrong_type_is_an_error) {
  expect_scene_error("duration_s: 1", "duration_s: long #!", "duration_s", "allowed a number");
  expect_scene_error("duration_s: 1", "duration_s: [1] #!", "duration_s", "found a list");
  expect_scene_error("duration_s: 1", "duration_s: +-1 #!", "duration_s", "allowed a number");
  expect_scene_error("each_way: 1", "each_way: 1.5 #!\n", "roads.0.lanes.each_way", "whole number");
  expect_scene_error("fields: false", "fields: no #!", "fields", "allowed true or false");
  expect_scene_error("detail: mid", "detail: medium #!", "detail", "allowed box, low, mid, fine");
  expect_scene_error("seed: 1", "seed: -1 #!", "seed", "whole number");
  expect_scene_error("name: crossing", "name: {a: b} #!", "name", "allowed a text");
  expect_scene_error("roads: [main, side]", "roads: main #!", "junctions.0.roads", "a list");
  expect_scene_error("[[-200, -200],", "[[-200], #!\n", "outline_m.0", "allowed 2");
  expect_scene_error("aggregation: slices:10", "aggregation: slices:0 #!", "aggregation",
                     "slices:N");
}

TEST(scene_file, a_number_out_of_range_is_an_error) {
  expect_scene_error("duration_s: 1", "duration_s: 0 #!", "duration_s", "allowed 0.1 to 36000");
  expect_scene_error("height_m: 5}", "height_m: 0} #!", "buildings.0.height_m", "above 0 to 1000");
  expect_scene_error("{Car: 0.8,", "{Car: -0.8, #!\n", "traffic.class_shares.Car", "0 to 1");
}

TEST(scene_file, a_lane_of_no_width_is_an_error) {
  expect_scene_error("width_m: 3.5", "width_m: 0 #!\n", "roads.0.lanes.width_m", "2.5 to 6");
}

TEST(scene_file, not_a_number_is_not_a_number) {
  for (const char* nan : {".nan", "nan", ".NaN", "1e999"})
    expect_scene_error("duration_s: 1", "duration_s: " + std::string(nan) + " #!", "duration_s",
                       "allowed");
}

TEST(scene_file, infinity_is_allowed_only_for_the_visibility) {
  expect_scene_error("duration_s: 1", "duration_s: .inf #!", "duration_s", "0.1 to 36000");
  expect_scene_error("{x_m: 5,", "{x_m: .inf, #!\n", "mounts.pole.x_m", "allowed");
  expect_scene_error("visibility_m: 500", "visibility_m: -.inf #!\n", "weather.visibility_m",
                     "allowed");
  const TestFolder folder;
  const auto file = folder.write("scene.yaml", replaced(kScene, "500}", ".inf}"));
  EXPECT_EQ(read_scene(file).weather.visibility_m, kInf);
}

TEST(scene_file, malformed_yaml_is_an_error_with_its_line) {
  expect_scene_error("duration_s: 1", "duration_s: ] #!", "(document)", "malformed");
}

TEST(scene_file, a_second_document_is_not_dropped_silently) {
  const TestFolder folder;
  const auto file = folder.write("scene.yaml", kScene + "---\nfields: true\n");
  error_of([&] { read_scene(file); });
}

TEST(scene_file, aliases_that_multiply_without_end_are_an_error) {
  std::string text = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n";
  for (int i = 1; i < 9; ++i) {
    const std::string last = "*a" + std::to_string(i - 1);
    text += "a" + std::to_string(i) + ": &a" + std::to_string(i) + " [" + last;
    for (int k = 1; k < 10; ++k) text += ", " + last;
    text += "]\n";
  }
  EXPECT_NE(error_of([&] { config::parse_tree(text, "bomb"); }).find("1000000"), std::string::npos);
}

TEST(scene_file, an_alias_to_what_holds_it_is_an_error) {
  error_of([] { config::parse_tree("a: &a [*a]\n", "loop"); });
}

TEST(scene_file, endless_nesting_is_an_error) {
  error_of([] { config::parse_tree(std::string(100000, '['), "deep"); });
}

TEST(scene_file, that_is_no_file_is_an_io_error) {
  const TestFolder folder;
  error_of<IoError>([&] { read_scene(folder.path() / "none.yaml"); });
  error_of<IoError>([&] { read_scene(folder.path()); });
}

TEST(scene_file, without_content_is_an_error) {
  const TestFolder folder;
  error_of([&] { read_scene(folder.write("scene.yaml", "")); });
}

TEST(scene_file, ground_must_be_convex_and_counter_clockwise) {
  const char* outline = "[[-200, -200], [200, -200], [200, 200], [-200, 200]]";
  const auto expect = [&](const char* wrong) {
    expect_scene_error(outline, std::string(wrong) + " #!", "ground.0.outline_m", "convex");
  };
  expect("[[-200, -200], [200, -200], [0, 0], [-200, 200]]");
  expect("[[-200, 200], [200, 200], [200, -200], [-200, -200]]");
  // A star of five lines turns left at every corner, and crosses itself.
  expect("[[100, 0], [-81, 59], [31, -95], [31, 95], [-81, -59]]");
}

TEST(scene_file, a_building_on_a_lane_is_an_error) {
  expect_scene_error("- {x_m: 50, y_m: 50,", "- {x_m: 50, y_m: 7, #!\n", "x_m", "on a lane");
  expect_scene_error("- {x_m: 50, y_m: 50,", "- {x_m: 0, y_m: 0, #!\n", "x_m", "on a lane");
}

TEST(scene_file, a_barrier_on_a_lane_is_an_error) {
  expect_scene_error("offset_m: 8", "offset_m: 2 #!\n", "offset_m", "on a lane");
}

TEST(scene_file, a_barrier_across_another_roads_lanes_is_an_error) {
  expect_scene_error("offset_m: 8, from_m: 10, to_m: 60}", "offset_m: 0, from_m: 10} #!",
                     "offset_m", "on a lane");
}

TEST(scene_file, a_barrier_or_gantry_beyond_its_road_is_an_error) {
  expect_scene_error("from_m: 10, to_m: 60", "from_m: 300 #!\n", "from_m", "beyond");
  expect_scene_error("s_m: 30", "s_m: 300 #!\n", "s_m", "beyond");
}

TEST(scene_file, an_unknown_road_is_an_error) {
  expect_scene_error("{road: main, offset_m: 8", "{road: mian, offset_m: 8 #!\n", "road", "'mian'");
  expect_scene_error("- {road: main, s_m", "- {road: mian, s_m: 30} #!\n#", "road", "'mian'");
  expect_scene_error("[main, side]", "[main, mian] #!", "roads", "'mian'");
}

TEST(scene_file, two_roads_of_one_name_are_an_error) {
  const TestFolder folder;
  const auto file = folder.write("scene.yaml", replaced(kScene, "- name: side", "- name: main"));
  EXPECT_NE(error_of([&] { build_world(read_scene(file)); }).find("main"), std::string::npos);
}

TEST(scene_file, a_junction_needs_two_roads_that_cross) {
  expect_scene_error("start: {x_m: 0, y_m: -100,", "start: {x_m: 500, y_m: -100,", "roads",
                     "do not cross");
}

}  // namespace
}  // namespace infrasim
