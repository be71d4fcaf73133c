#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "infrasim/config/fields.h"
#include "infrasim/config/lidar_changes.h"
#include "infrasim/config/lidar_config.h"
#include "infrasim/config/lidar_tables.h"
#include "infrasim/config/scene_config.h"
#include "infrasim/config/tree.h"
#include "infrasim/io/npy.h"
#include "infrasim/pipeline/simulate.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::configs;
using testing::error_of;
using testing::expect_message;
using testing::expect_within;
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

/// Returns the number of the line that the comment `#!` marks.
int marked_line(const std::string& text) {
  const auto mark = text.find("#!");
  if (mark == std::string::npos) throw std::logic_error("no line is marked");
  return 1 +
         static_cast<int>(std::count(text.begin(), text.begin() + static_cast<long>(mark), '\n'));
}

/// Replaces `part`. The resulting error must name the line that ends in `#!`.
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
  expect_scene_error("width_m: 3.5", "width: 3.5 #!\n", "roads.0.lanes.width", "width_m");
}

TEST(scene_file, an_unknown_key_is_answered_with_a_similar_one) {
  expect_scene_error("centreline:\n      - line_m: 200", "centerline:\n      - line_m: 200 #!",
                     "roads.0.centerline", "got an unknown key; did you mean 'centreline'?");
  expect_scene_error("visibility_m: 500}", "visibility: 500} #!", "weather.visibility",
                     "did you mean 'visibility_m'?");
}

TEST(scene_file, a_decimal_comma_is_named) {
  const std::string hint = "; numbers have a decimal point, not a comma";
  expect_scene_error("width_m: 3.5", "width_m: 3,5, shoulder_m: 1 #!\n", "roads.0.lanes.5", hint);
  expect_scene_error("z_m: 6}", "z_m: \"-7,05\"} #!", "mounts.pole.z_m", "got '-7,05'" + hint);
  expect_scene_error("{Car: 0.8, Bus: 0.2}", "{Car: 0,8} #!", "traffic.class_shares.8", hint);
  expect_scene_error("{Car: 0.8, Bus: 0.2}", "{Car: 0,5, Bus: 0,5} #!", "5", "twice" + hint);
  const auto message = [](const std::string& value) {
    return error_of([&] {
      parse_scene(replaced(kScene, "duration_s: 1", "duration_s: " + value), "scene", "");
    });
  };
  EXPECT_EQ(message("long").find(hint), std::string::npos);
  EXPECT_EQ(message("1,2,3").find(hint), std::string::npos);
}

TEST(scene_file, a_value_for_a_map_is_answered_with_the_keys_of_the_map) {
  expect_scene_error("speed: {mean_km_h: 50}", "speed: 50 #!", "traffic.speed",
                     "expected a map with the keys mean_km_h, std_km_h, got '50'");
  expect_scene_error("{Car: 0.8, Bus: 0.2}", "1 #!", "traffic.class_shares",
                     "expected a map with the keys Car, Van, Truck, Bus, Motorcycle, got '1'");
  expect_scene_error("traffic:\n", "filters: [5] #!\ntraffic:\n", "filters.0",
                     "expected a map with the keys crop_box, crop_polygon, ");
  // A scene has too many keys for a useful list in the message.
  expect_within(error_of([] { parse_scene("just words", "scene", ""); }),
                "expected a map, got 'just words'");
}

TEST(scene_file, a_key_twice_is_an_error) {
  expect_scene_error("duration_s: 1", "duration_s: 1\nduration_s: 1 #!", "duration_s", "twice");
}

TEST(scene_file, a_missing_key_is_an_error) {
  expect_scene_error("seed: 1\nname: crossing", "seed: 1 #!", "name", "expected a value");
  expect_scene_error("{x_m: 5, y_m: -9, z_m: 6}", "{x_m: 5, y_m: -9} #!", "mounts.pole.z_m",
                     "expected a value");
  expect_scene_error("- {road: main, s_m: 30}", "- {s_m: 30} #!", "gantries.0.road",
                     "expected a value");
}

TEST(scene_file, a_wrong_type_is_an_error) {
  expect_scene_error("duration_s: 1", "duration_s: long #!", "duration_s", "expected a number");
  expect_scene_error("duration_s: 1", "duration_s: [1] #!", "duration_s", "got a list");
  expect_scene_error("duration_s: 1", "duration_s: -+1 #!", "duration_s", "expected a number");
  expect_scene_error("x_m: 5,", "x_m: +-5, #!\n", "mounts.pole.x_m", "expected a number");
  expect_scene_error("each_way: 1", "each_way: 1.5 #!\n", "roads.0.lanes.each_way", "whole number");
  expect_scene_error("fields: false", "fields: no #!", "fields", "expected true or false");
  expect_scene_error("detail: mid", "detail: medium #!", "detail", "expected box, low, mid, fine");
  expect_scene_error("seed: 1", "seed: -1 #!", "seed", "whole number");
  expect_scene_error("name: crossing", "name: {a: b} #!", "name", "expected a text");
  expect_scene_error("roads: [main, side]", "roads: main #!", "junctions.0.roads", "a list");
  expect_scene_error("[[-200, -200],", "[[-200], #!\n", "ground.0.outline_m.0", "expected 2");
  expect_scene_error("aggregation: slices:10", "aggregation: slices:0 #!", "aggregation",
                     "slices:N");
}

TEST(scene_file, a_number_out_of_range_is_an_error) {
  expect_scene_error("duration_s: 1", "duration_s: 0 #!", "duration_s", "expected 0.1 to 36000");
  expect_scene_error("height_m: 5}", "height_m: 0} #!", "buildings.0.height_m", "above 0 to 1000");
  expect_scene_error("{Car: 0.8,", "{Car: -0.8, #!\n", "traffic.class_shares.Car", "0 to 1");
}

TEST(scene_file, a_lane_of_no_width_is_an_error) {
  expect_scene_error("width_m: 3.5", "width_m: 0 #!\n", "roads.0.lanes.width_m", "2.5 to 6");
}

TEST(scene_file, not_a_number_is_not_a_number) {
  for (const char* nan : {".nan", "nan", ".NaN", "1e999"})
    expect_scene_error("duration_s: 1", "duration_s: " + std::string(nan) + " #!", "duration_s",
                       "expected");
}

TEST(scene_file, infinity_is_allowed_only_for_the_visibility) {
  expect_scene_error("duration_s: 1", "duration_s: .inf #!", "duration_s", "0.1 to 36000");
  expect_scene_error("{x_m: 5,", "{x_m: .inf, #!\n", "mounts.pole.x_m", "expected");
  expect_scene_error("visibility_m: 500", "visibility_m: -.inf #!\n", "weather.visibility_m",
                     "expected");
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

TEST(scene_file, punctuation_after_its_content_is_an_error_and_no_endless_loop) {
  for (const char* text : {",", "{name: a} , b"})
    EXPECT_EXIT(
        {
          ::alarm(2);
          error_of([&] { config::parse_tree(text, "text"); });
          std::_Exit(::testing::Test::HasFailure());
        },
        ::testing::ExitedWithCode(0), "")
        << text;
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
  // The star of five lines turns left at every corner and crosses itself.
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
  expect_scene_error("from_m: 10, to_m: 60", "from_m: 300 #!\n", "from_m", "got 300");
  expect_scene_error("s_m: 30", "s_m: 300 #!\n", "s_m", "got 300");
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

TEST(scene_file, a_bend_tighter_than_the_road_is_wide_is_an_error) {
  const TestFolder folder;
  const auto file = folder.write("scene.yaml", replaced(kScene, "radius_m: 400", "radius_m: 5"));
  EXPECT_NE(error_of([&] { build_world(read_scene(file)); }).find("radius_m"), std::string::npos);
}

TEST(scene_file, a_roads_name_is_refused_or_keeps_the_seven_columns_of_roads_csv) {
  for (const std::string& name : {std::string("a,b"), std::string(300, 'x')}) {
    SceneConfig scene = testing::empty_road();
    scene.roads.front().name = name;
    std::string csv;
    try {
      csv = build_world(parse_scene(dump_scene(scene), "scene")).region.roads_csv();
    } catch (const ConfigError&) {
      continue;
    }
    EXPECT_EQ(std::ranges::count(csv, ','), 6 * std::ranges::count(csv, '\n')) << name;
    EXPECT_GT(std::ranges::count(csv, '\n'), 100) << name;
  }
}

TEST(scene_file, a_junction_needs_two_roads_that_meet) {
  expect_scene_error("roads: [main, side]", "roads: [main, main] #!", "roads", "do not meet");
  expect_scene_error("roads: [main, side]", "roads: [main] #!", "junctions.0.roads", "expected 2");
  const TestFolder folder;
  const auto file =
      folder.write("scene.yaml", replaced(kScene, "x_m: 0, y_m: -100", "x_m: 150, y_m: -100"));
  EXPECT_NE(error_of([&] { build_world(read_scene(file)); }).find("do not meet"),
            std::string::npos);
}

TEST(scene_file, an_unknown_class_is_an_error_that_names_the_known_ones) {
  expect_scene_error("{Car: 0.8,", "{Tram: 0.8, #!\n", "traffic.class_shares", "expected Car, Van");
}

TEST(scene_file, shares_of_no_class_are_an_error) {
  expect_scene_error("{Car: 0.8, Bus: 0.2}", "{Car: 0, Bus: 0} #!", "traffic.class_shares",
                     "above 0");
  expect_scene_error("{Car: 0.8, Bus: 0.2}", "{} #!", "traffic.class_shares", "expected entries");
}

TEST(scene_file, has_either_traffic_or_trajectories) {
  expect_scene_error("traffic:\n  vehicles_per_km_lane: 10",
                     "trajectories: file.csv\ntraffic:\n  vehicles_per_km_lane: 10 #!", "traffic",
                     "both");
  const TestFolder folder;
  const auto file = folder.write("scene.yaml", kScene.substr(0, kScene.find("traffic:")));
  expect_message(error_of([&] { read_scene(file); }), file, 1, "traffic", "neither");
}

TEST(scene_file, has_a_mount_at_least) {
  expect_scene_error("mounts:\n  pole: {x_m: 5, y_m: -9, z_m: 6}", "mounts: {} #!", "mounts",
                     "expected entries");
}

// --- dump and load ----------------------------------------------------------------------------

/// Dumps the scene of a text, and reads the dump again.
std::string loaded_and_dumped(const std::string& text) {
  const TestFolder folder;
  return dump_scene(read_scene(folder.write("scene.yaml", text)));
}

TEST(dump, of_a_scene_reads_back_to_the_same_scene) {
  const std::string dumped = loaded_and_dumped(kScene);
  EXPECT_EQ(loaded_and_dumped(dumped), dumped);
  for (const char* value : {"visibility_m: 500", "each_way: 2", "radius_m: 400", "Bus: 0.2"})
    EXPECT_NE(dumped.find(value), std::string::npos) << value;
}

TEST(dump, of_each_committed_scene_reads_back_to_the_same_scene) {
  int scenes = 0;
  for (const auto& entry : std::filesystem::directory_iterator(configs() / "scenes")) {
    SCOPED_TRACE(entry.path());
    const std::string dumped = dump_scene(read_scene(entry.path()));
    EXPECT_EQ(loaded_and_dumped(dumped), dumped);
    ++scenes;
  }
  EXPECT_GE(scenes, 3);
}

TEST(dump, of_each_committed_lidar_and_preset_reads_back_to_the_same_lidar) {
  int lidars = 0;
  for (const auto& entry : std::filesystem::directory_iterator(configs() / "lidars")) {
    if (entry.path().extension() != ".yaml") continue;
    for (const std::string& preset : preset_names(entry.path())) {
      SCOPED_TRACE(entry.path().string() + " " + preset);
      LidarConfig lidar;
      try {
        lidar = read_lidar(entry.path(), preset);
      } catch (const IoError&) {
        continue;  // the user must download its table
      }
      const TestFolder folder;
      const std::string dumped = dump_lidar(lidar);
      EXPECT_EQ(dump_lidar(read_lidar(folder.write("lidar.yaml", dumped), preset)), dumped);
      ++lidars;
    }
  }
  EXPECT_GE(lidars, 12);
}

TEST(dump, keeps_any_text_of_a_name) {
  for (const char* name :
       {"a: b", "a # no comment", "a\\", "a\"", "a'", "null", "true", "007", "1e5", "ü", "x "}) {
    SCOPED_TRACE(name);
    SceneConfig scene = testing::empty_road();
    scene.name = name;
    scene.roads.front().name = name;
    const TestFolder folder;
    const SceneConfig back = read_scene(folder.write("scene.yaml", dump_scene(scene)));
    EXPECT_EQ(back.name, name);
    EXPECT_EQ(back.roads.front().name, name);
  }
}

TEST(dump, keeps_any_name_of_a_mount) {
  for (const char* name : {"a: b", "# no comment", "\"", "{", "~", "- x", " x "}) {
    SCOPED_TRACE(name);
    SceneConfig scene = testing::empty_road();
    scene.mounts = {{name, MountConfig{}}};
    const TestFolder folder;
    const SceneConfig back = read_scene(folder.write("scene.yaml", dump_scene(scene)));
    EXPECT_EQ(back.mounts.begin()->first, name);
  }
}

TEST(dump, quotes_names_that_yaml_takes_for_other_values) {
  for (const char* name : {"y", "N", "Yes", "no", "ON", "off", "true", "False", "NULL", "~", "1",
                           "010", "1e3", "0x1F", "-1", ".5", "12:30"})
    EXPECT_EQ(config::quoted_name(name), "\"" + std::string(name) + "\"");
  for (const char* name : {"pole", "Car", "north_2", "yes_1", "nil", "e1"})
    EXPECT_EQ(config::quoted_name(name), name);
  SceneConfig scene = testing::empty_road();
  scene.mounts = {{"no", MountConfig{}}};
  EXPECT_NE(dump_scene(scene).find("\n  \"no\":"), std::string::npos);
}

TEST(dump, keeps_the_order_of_mounts) {
  SceneConfig scene = testing::empty_road();
  scene.mounts = {{"south", {.y_m = -20}}, {"north", {.y_m = 20}}};
  const SceneConfig back = parse_scene(dump_scene(scene), "scene");
  EXPECT_EQ(back.mounts.begin()->first, "south");
  EXPECT_EQ(back.mounts.at("north").y_m, 20);
}

TEST(scene_at_mount, leaves_one_mount_with_draws_of_its_own) {
  SceneConfig scene = testing::empty_road();
  scene.mounts = {{"south", {.y_m = -20}}, {"north", {.y_m = 20}}};
  const SceneConfig view = scene_at_mount(scene, "north");
  ASSERT_EQ(view.mounts.size(), 1U);
  EXPECT_EQ(view.mounts.at("north").y_m, 20);
  EXPECT_EQ(view.mounts.at("north").own_random_stream, true);
  EXPECT_EQ(error_of([&] { scene_at_mount(scene, ""); }), "mount: expected south, north, got none");
  EXPECT_EQ(error_of([&] { scene_at_mount(scene, "west"); }),
            "mount: expected south, north, got 'west'");
}

TEST(scene_at_mount, leaves_a_lone_mount_as_it_is) {
  const SceneConfig scene = testing::empty_road();
  EXPECT_EQ(dump_scene(scene_at_mount(scene, "")), dump_scene(scene));
}

TEST(dump, keeps_every_digit_of_a_number) {
  for (const double value : {0.1, 1.0 / 3, 1e-300, 123456789.123456, -0.0, 5.0}) {
    SceneConfig scene = testing::empty_road();
    scene.mounts["pole"].x_m = value;
    const TestFolder folder;
    const SceneConfig back = read_scene(folder.write("scene.yaml", dump_scene(scene)));
    EXPECT_EQ(back.mounts.at("pole").x_m, value);
  }
}

// --- --set KEY=VALUE --------------------------------------------------------------------------

SceneConfig scene_with(const std::vector<std::string>& assignments) {
  const TestFolder folder;
  return read_scene(folder.write("scene.yaml", kScene), assignments);
}

TEST(set_option, overrides_by_dotted_path_and_list_index) {
  const SceneConfig scene =
      scene_with({"mounts.pole.z_m=7.5", "roads.1.lanes.each_way=3", "seed=9", "seed=10"});
  EXPECT_EQ(scene.mounts.at("pole").z_m, 7.5);
  EXPECT_EQ(scene.mounts.at("pole").x_m, 5);
  EXPECT_EQ(scene.roads.at(1).lanes.each_way, 3);
  EXPECT_EQ(scene.roads.at(0).lanes.each_way, 1);
  EXPECT_EQ(scene.seed, 10U);
}

TEST(set_option, creates_keys_that_stand_at_their_default) {
  const SceneConfig scene = scene_with({"labels=all", "roads.0.embankment.foot_elevation_m=-5"});
  EXPECT_EQ(scene.labels, LabelRule::kAll);
  EXPECT_EQ(scene.roads.at(0).embankment->foot_elevation_m, -5);
}

TEST(set_option, takes_lists_and_maps) {
  const SceneConfig scene = scene_with({"traffic.class_shares={Van: 1}", "buildings=[]"});
  EXPECT_EQ(scene.traffic->class_shares.size(), 1U);
  EXPECT_TRUE(scene.buildings.empty());
}

TEST(set_option, errors_name_the_option_and_the_key) {
  const auto expect = [](const std::string& assignment, const std::string& key) {
    const std::string message = error_of([&] { scene_with({assignment}); });
    EXPECT_TRUE(message.starts_with("--set " + assignment)) << message;
    EXPECT_NE(message.find(": " + key + ": "), std::string::npos) << message << "\n  key " << key;
  };
  expect("durations=1", "durations");
  expect("mounts.pole.z=1", "mounts.pole.z");
  expect("duration_s=none", "duration_s");
  expect("traffic.class_shares={Tram: 1}", "traffic.class_shares");
  expect("roads.7.name=x", "7");
  expect("roads.x.name=x", "x");
  expect("seed.x=1", "x");
  expect("seed", "(option)");
  expect("=1", "(option)");
  expect("seed=[", "(document)");
  expect("mounts.pole..z_m=1", "(option)");
  expect("mounts.pole.tilt.deg=1", "mounts.pole.tilt");
  expect("roads.0.embankment.run_per_rise=2", "roads.0.embankment.foot_elevation_m");
}

// --- LiDAR files ------------------------------------------------------------------------------

const std::string kLidar = R"(name: two
model: Two lines
price_usd: {low: 1, high: 2, source: nobody, date: "2025"}
pattern:
  spinning: {rate_hz: 10, azimuth_step_deg: 0.2}
presets:
  even:
    pattern: {spinning: {channels: {count: 2, upper_deg: 1, lower_deg: -1}}}
    returns: {max_range_m: 100, range_accuracy_m: 0.02}
  table:
    pattern: {spinning: {channels: {file: two.csv}}}
    returns: {max_range_m: 100, detection: {range_at_10_percent_m: 90}}
)";
const std::string kHeader = "channel,elevation_deg,azimuth_offset_deg,fire_time_us\n";

void expect_lidar_error(const std::string& part, const std::string& by, const std::string& key,
                        const std::string& what) {
  SCOPED_TRACE(by);
  const TestFolder folder;
  const std::string text = replaced(kLidar, part, by);
  const auto file = folder.write("lidar.yaml", text);
  expect_message(error_of([&] { read_lidar(file, "even"); }), file, marked_line(text), key, what);
}

TEST(lidar_file, evenly_spaced_channels_go_from_upper_to_lower) {
  const TestFolder folder;
  const LidarConfig lidar = read_lidar(folder.write("lidar.yaml", kLidar), "even");
  const auto& table = lidar.units.at(0).pattern.spinning->channels.table;
  ASSERT_EQ(table.size(), 2U);
  EXPECT_EQ(table[0].elevation_deg, 1);
  EXPECT_EQ(table[1].elevation_deg, -1);
  EXPECT_EQ(lidar.preset, "even");
}

TEST(lidar_file, one_channel_has_one_elevation) {
  const auto elevation = [](const std::string& angles) {
    const TestFolder folder;
    const std::string text =
        replaced(kLidar, "count: 2, upper_deg: 1, lower_deg: -1", "count: 1" + angles);
    const LidarConfig lidar = read_lidar(folder.write("lidar.yaml", text), "even");
    const auto& table = lidar.units.at(0).pattern.spinning->channels.table;
    EXPECT_EQ(table.size(), 1U);
    return table.front().elevation_deg;
  };
  EXPECT_EQ(elevation(", upper_deg: -3, lower_deg: -3"), -3);
  EXPECT_EQ(elevation(", upper_deg: -3"), -3);
  EXPECT_EQ(elevation(", lower_deg: -3"), -3);
  EXPECT_EQ(elevation(""), 0);
  expect_lidar_error("count: 2, upper_deg: 1, lower_deg: -1",
                     "count: 1, upper_deg: 1, lower_deg: -1 #!\n",
                     "pattern.spinning.channels.upper_deg", "one elevation");
  expect_lidar_error("count: 2, upper_deg: 1, lower_deg: -1",
                     "count: 2, upper_deg: 1, lower_deg: 1 #!\n",
                     "pattern.spinning.channels.upper_deg", "above");
}

TEST(lidar_file, an_unknown_preset_is_an_error_that_names_the_known_ones) {
  const TestFolder folder;
  const auto file = folder.write("lidar.yaml", kLidar);
  expect_message(error_of([&] { read_lidar(file, "paper"); }), file, 7, "presets",
                 "expected even, table, got unknown preset 'paper'");
}

TEST(lidar_file, preset_names_come_in_the_order_of_the_file) {
  const TestFolder folder;
  EXPECT_EQ(preset_names(folder.write("lidar.yaml", kLidar)),
            (std::vector<std::string>{"even", "table"}));
}

TEST(lidar_file, keys_are_checked) {
  expect_lidar_error("max_range_m: 100, range", "max_range_m: 0, #!\n range", "returns.max_range_m",
                     "above 0");
  expect_lidar_error("range_accuracy_m: 0.02", "min_range_m: 100 #!\n", "returns.max_range_m",
                     "min_range_m");
  expect_lidar_error("range_accuracy_m: 0.02", "accuracy_m: 0.02 #!\n", "returns.accuracy_m",
                     "range_accuracy_m");
  expect_lidar_error("{rate_hz: 10, azi", "{rate_hz: .inf, #!\n azi", "pattern.spinning.rate_hz",
                     "expected 5 to 20");
  expect_lidar_error("low: 1, high: 2", "low: 3, high: 2 #!\n", "price_usd.high", "low or more");
  expect_lidar_error("name: two", "name: a/b #!", "name", "without /");
  expect_lidar_error("upper_deg: 1, lower_deg: -1", "upper_deg: -1, lower_deg: 1 #!\n",
                     "pattern.spinning.channels.upper_deg", "above");
  expect_lidar_error("count: 2, upper", "file: a.csv, count: 2, #!\n upper",
                     "pattern.spinning.channels.count", "one of");
  expect_lidar_error("azimuth_step_deg: 0.2}\n",
                     "azimuth_step_deg: 0.2} #!\n  table: {file: a.csv, rays_per_s: 20}\n",
                     "pattern.spinning", "one of spinning, prisms, table");
}

TEST(lidar_file, targets_without_a_signal_are_not_detected) {
  const auto with = [](const std::string& steepness) {
    return "detection: {range_at_10_percent_m: 90, steepness: " + steepness + "}";
  };
  for (const char* low : {"0.5", "1", "3.7"})
    expect_lidar_error("range_accuracy_m: 0.02", with(low) + " #!\n", "returns.detection.steepness",
                       "without a signal");
  const TestFolder folder;
  const std::string text = replaced(kLidar, "range_accuracy_m: 0.02", with("3.72"));
  read_lidar(folder.write("lidar.yaml", text), "even");
}

TEST(lidar_file, a_value_for_a_map_is_answered_with_the_keys_of_the_map) {
  expect_lidar_error("{low: 1, high: 2, source: nobody, date: \"2025\"}", "3600 #!", "price_usd",
                     "expected a map with the keys low, high, source, date, got '3600'");
}

TEST(lidar_file, presets_are_maps) {
  expect_lidar_error("presets:\n", "presets: 5 #!\nother:\n", "presets", "expected a map, got '5'");
  expect_lidar_error("  even:\n", "  even: 5 #!\n  odd:\n", "presets.even", "got '5'");
  expect_lidar_error("  even:\n", "  even: ~ #!\n  odd:\n", "presets.even", "got nothing");
  expect_lidar_error("  even:\n", "  even:\n    presets: {a: 1} #!\n", "presets", "unknown key");
}

TEST(lidar_file, a_frame_has_at_least_one_ray_and_no_more_than_memory_holds) {
  const auto expect = [](const std::string& by, const std::string& key, const std::string& what) {
    expect_lidar_error("rate_hz: 10, azimuth_step_deg: 0.2}", by + "} #!", "pattern." + key, what);
  };
  expect("rate_hz: 10, azimuth_step_deg: 1e-9", "spinning.azimuth_step_deg",
         "expected 20 to 100000000 columns a second, got 3600000000000");
  expect("rate_hz: 10, azimuth_step_deg: 1e-8", "spinning.azimuth_step_deg", "expected 20 to");
  expect("rate_hz: 10, azimuth_step_deg: 1e-300", "spinning.azimuth_step_deg", "1.0e-09 or more");
  expect("rate_hz: 4.9, azimuth_step_deg: 0.2", "spinning.rate_hz", "expected 5 to 20, got");
  expect("rate_hz: 20.1, azimuth_step_deg: 0.2", "spinning.rate_hz", "expected 5 to 20, got");
  expect("rate_hz: 20, columns_per_turn: 50000000", "spinning.columns_per_turn", "1000000000");
}

TEST(lidar_file, rays_of_all_lasers_and_units_are_counted) {
  const TestFolder folder;
  const auto file = folder.write(
      "lidar.yaml", replaced(replaced(kLidar, "azimuth_step_deg: 0.2", "columns_per_turn: 9e5"),
                             "9e5", "900000"));
  EXPECT_NO_THROW(read_lidar(file, "even"));  // 18 million rays a second
  const auto many = folder.write(
      "many.yaml", "name: many\nbundle: [" + [] {
        std::string list;
        for (int i = 0; i < 6; ++i) list += "{lidar: lidar.yaml}, ";
        return list;
      }() + "]\n");
  const std::string message = error_of([&] { read_lidar(many, "even"); });
  EXPECT_NE(
      message.find("many.yaml: (rays per second): expected at most 100000000 in one LiDAR, got "
                   "108000000"),
      std::string::npos)
      << message;
}

TEST(lidar_file, columns_per_turn_stand_for_a_step) {
  const TestFolder folder;
  const auto resolved = [&](const std::string& by) {
    const auto file = folder.write("lidar.yaml", replaced(kLidar, "azimuth_step_deg: 0.2", by));
    return dump_lidar(read_lidar(file, "even"));
  };
  EXPECT_NE(resolved("columns_per_turn: 1800").find("\n    columns_per_turn: 1800\n"),
            std::string::npos);
  EXPECT_NE(resolved("columns_per_turn: 16250/8").find("\n    columns_per_turn: 8125/4\n"),
            std::string::npos);
  EXPECT_EQ(resolved("azimuth_step_deg: 0.2").find("columns_per_turn"), std::string::npos);
  const auto reread = folder.write("resolved.yaml", resolved("columns_per_turn: 8125/4"));
  EXPECT_EQ(dump_lidar(read_lidar(reread, "even")), resolved("columns_per_turn: 8125/4"));
}

TEST(lidar_file, columns_per_turn_are_a_whole_number_or_a_fraction) {
  for (const char* text : {"0", "-4", "1800.5", "1800/0", "1800/-1", "1800/", "/4", "1800/4/2",
                           "1800 / 4", "1e3", ".inf", "99999999999/1", "[1800]"}) {
    expect_lidar_error("azimuth_step_deg: 0.2}", "columns_per_turn: " + std::string(text) + "} #!",
                       "pattern.spinning.columns_per_turn", "a fraction such as 8125/4");
  }
  expect_lidar_error("azimuth_step_deg: 0.2}", "columns_per_turn: 15/4} #!",
                     "pattern.spinning.columns_per_turn", "expected 4 to 1000000000, got '15/4'");
  expect_lidar_error("azimuth_step_deg: 0.2}", "azimuth_step_deg: 0.2, columns_per_turn: 1800} #!",
                     "pattern.spinning.columns_per_turn", "got none or several");
  expect_lidar_error("rate_hz: 10, azimuth_step_deg: 0.2}", "rate_hz: 10} #!",
                     "pattern.spinning.azimuth_step_deg", "got none or several");
}

TEST(lidar_file, a_cycle_is_an_exact_fraction_of_a_turn_at_each_rate) {
  const TestFolder folder;
  const auto fraction = [&](const std::string& by) {
    const auto file =
        folder.write("lidar.yaml", replaced(kLidar, "rate_hz: 10, azimuth_step_deg: 0.2", by));
    const SpinningConfig spinning = *read_lidar(file, "even").units.at(0).pattern.spinning;
    const auto columns = columns_per_turn(spinning);
    EXPECT_NEAR(columns_per_s(spinning), columns->value() * spinning.rate_hz, 1e-6);
    return std::to_string(columns->numerator) + "/" + std::to_string(columns->denominator);
  };
  EXPECT_EQ(fraction("rate_hz: 10, cycle_us: 55.296"), "390625/216");
  EXPECT_EQ(fraction("rate_hz: 20, cycle_us: 55.296"), "390625/432");
  EXPECT_EQ(fraction("rate_hz: 10, cycle_us: 57.6"), "15625/9");
  EXPECT_EQ(fraction("rate_hz: 10, cycle_us: 50"), "2000/1");
  EXPECT_EQ(fraction("rate_hz: 5, cycle_us: 0.1"), "2000000/1");
}

TEST(lidar_file, a_cycle_of_too_many_digits_has_no_exact_fraction) {
  SpinningConfig spinning;
  spinning.cycle_us = 55.296000001;
  EXPECT_FALSE(columns_per_turn(spinning));
  spinning.cycle_us = 50;
  EXPECT_TRUE(columns_per_turn(spinning));
  spinning.rate_hz = 1 / 3.0;
  EXPECT_FALSE(columns_per_turn(spinning));
}

TEST(lidar_file, a_cycle_replaces_the_columns_of_a_turn) {
  expect_lidar_error("azimuth_step_deg: 0.2}", "azimuth_step_deg: 0.2, cycle_us: 50} #!",
                     "pattern.spinning.cycle_us", "got none or several");
  expect_lidar_error("azimuth_step_deg: 0.2}", "columns_per_turn: 1800, cycle_us: 50} #!",
                     "pattern.spinning.cycle_us", "got none or several");
  expect_lidar_error("azimuth_step_deg: 0.2}", "cycle_us: 0} #!", "pattern.spinning.cycle_us",
                     "above 0");
  expect_lidar_error("azimuth_step_deg: 0.2}", "cycle_us: 30000} #!", "pattern.spinning.cycle_us",
                     "expected 4 or more columns per turn, got 3.3");
}

TEST(lidar_file, a_reflectance_is_that_of_a_target) {
  for (const char* value : {"1e-320", "0", "0.0005", "1.1"})
    expect_lidar_error("max_range_m: 100, range_accuracy_m: 0.02}",
                       "max_range_m: 100, detection: {range_at_10_percent_m: 50, further_ranges: "
                       "[{range_m: 9, reflectance: " +
                           std::string(value) + "}]}} #!",
                       "returns.detection.further_ranges.0.reflectance", "expected 0.001 to 1");
}

TEST(lidar_file, a_law_exponent_stands_only_without_further_ranges) {
  const std::string detection = "max_range_m: 100, range_accuracy_m: 0.02}";
  const auto with = [](const std::string& keys) {
    return "max_range_m: 100, detection: {range_at_10_percent_m: 50, " + keys + "}} #!";
  };
  expect_lidar_error(detection,
                     with("law_exponent: 0.3, further_ranges: [{range_m: 90, reflectance: 0.8}]"),
                     "returns.detection.law_exponent", "expected law_exponent or further_ranges");
  for (const char* value : {"0.2", "0.51"})
    expect_lidar_error(detection, with(std::string("law_exponent: ") + value),
                       "returns.detection.law_exponent", "expected 0.25 to 0.5");
}

TEST(lidar_file, a_beam_has_a_middle_and_echoes_need_received_power) {
  const std::string returns = "max_range_m: 100, range_accuracy_m: 0.02}";
  const std::string beam = "max_range_m: 100, beam: {vertical_deg: 0.1, horizontal_deg: 0.1, ";
  expect_lidar_error(returns, beam + "sub_rays: 4}} #!", "returns.beam.sub_rays",
                     "expected an odd number, got 4");
  expect_lidar_error(returns, beam + "where: here}} #!", "returns.beam.where", "everywhere");
  expect_lidar_error(returns, "max_range_m: 100, echoes: {mode: dual}} #!", "returns.echoes",
                     "because returns.detection is missing");
  const std::string detection = "max_range_m: 100, detection: {range_at_10_percent_m: 50}, ";
  expect_lidar_error(returns, detection + "echoes: {mode: dual, offered: [last, first]}} #!",
                     "returns.echoes.mode", "offers (last, first), got dual");
}

TEST(lidar_file, an_exponent_is_set_on_units_with_one_published_range) {
  const auto read = [](const char* name) {
    return read_lidar(configs() / "lidars" / (std::string(name) + ".yaml"), "datasheet");
  };
  LidarConfig ruby = read("ruby_plus"), avia = read("livox_avia");
  EXPECT_TRUE(set_law_exponent(ruby, 0.5));
  EXPECT_EQ(ruby.units.at(0).returns.detection->law_exponent, 0.5);
  EXPECT_FALSE(set_law_exponent(avia, 0.5));
  EXPECT_EQ(dump_lidar(avia), dump_lidar(read("livox_avia")));
  EXPECT_NE(error_of([&] { set_law_exponent(ruby, 0.6); }).find("expected 0.25 to 0.5, got 0.6"),
            std::string::npos);
}

/// Checks the error message for a file of channels with this text.
void expect_channels_error(const std::string& text, int line, const std::string& key,
                           const std::string& what) {
  SCOPED_TRACE(text);
  const TestFolder folder;
  const auto file = folder.write("two.csv", text);
  expect_message(error_of([&] { config::read_channels(file); }), file, line, key, what);
}

TEST(channel_table, blank_offsets_and_times_are_unpublished_and_read_as_0) {
  const TestFolder folder;
  const auto channels =
      config::read_channels(folder.write("two.csv", kHeader + "1,-1,,\n2,1,3,4\n"));
  ASSERT_EQ(channels.size(), 2U);
  EXPECT_EQ(channels[0].elevation_deg, -1);
  EXPECT_EQ(channels[0].azimuth_offset_deg, 0);
  EXPECT_EQ(channels[0].fire_time_us, 0);
  EXPECT_EQ(channels[1].azimuth_offset_deg, 3);
  EXPECT_EQ(channels[1].fire_time_us, 4);
}

TEST(channel_table, errors_name_the_line_and_the_column) {
  expect_channels_error("id,elevation_deg\n1,0\n", 1, "(header)",
                        "expected 'channel,elevation_deg");
  expect_channels_error("", 1, "(header)", "expected 'channel,elevation_deg");
  expect_channels_error(kHeader, 1, "(rows)", "got none");
  expect_channels_error(kHeader + "1,0,,\n2,nan,,\n", 3, "elevation_deg", "'nan'");
  expect_channels_error(kHeader + "1,,0,0\n", 2, "elevation_deg", "''");
  expect_channels_error(kHeader + "1,91,,\n", 2, "elevation_deg", "-90");
  expect_channels_error(kHeader + "1,0,0\n", 2, "(row)", "4 columns");
  expect_channels_error(kHeader + "1,0,0,0,0\n", 2, "(row)", "4 columns");
  expect_channels_error(kHeader + "1,0,0,-1\n", 2, "fire_time_us", "'-1'");
  expect_channels_error(kHeader + "banana,0,,\n", 2, "channel", "'banana'");
  expect_channels_error(kHeader + "1.5,0,,\n", 2, "channel", "a whole number, got 1.5");
  expect_channels_error(kHeader + "1,0,,\n2,1,,\n1,2,,\n", 4, "channel", "got 1 twice");
  expect_channels_error(kHeader + std::string(100'000, '1'), 2, "(row)", "got a longer one");
}

TEST(channel_table, may_begin_with_a_byte_order_mark) {
  const TestFolder folder;
  const auto file = folder.write("two.csv", "\xEF\xBB\xBF" + kHeader + "1,-1,,\r\n2,1,3,4\r\n");
  EXPECT_EQ(config::read_channels(file).size(), 2U);
}

TEST(channel_table, has_a_row_for_each_channel) {
  const auto read = [](const std::string& rows) {
    const TestFolder folder;
    return config::read_channels(folder.write("two.csv", kHeader + rows)).size();
  };
  EXPECT_EQ(read("0,0,,\n1,1,,\n"), 2U);
  EXPECT_EQ(read("3,0,,\n1,1,,\n2,-1,,"), 3U);  // in any order
  EXPECT_NE(error_of([&] { read("0,0,,\n1,1,,\n3,2,,\n"); }).find("got none for 2"),
            std::string::npos);
  EXPECT_NE(error_of([&] { read("2,0,,\n3,1,,\n"); }).find("0 or 1 as the first number, got 2"),
            std::string::npos);
}

TEST(channel_table, may_have_columns_and_ranges_of_its_channels) {
  const TestFolder folder;
  const std::string header = kHeader.substr(0, kHeader.size() - 1);
  const auto all = config::read_channels(folder.write(
      "all.csv", header + ",column_step,first_column,range_at_10_percent_m,min_range_m\n"
                          "1,-1,,,,,,\n2,1,,,2,1,60,1.4\n"));
  EXPECT_EQ(all[0].column_step, 1);
  EXPECT_EQ(all[0].first_column, 0);
  EXPECT_FALSE(all[0].range_at_10_percent_m || all[0].min_range_m);
  EXPECT_EQ(all[1].column_step, 2);
  EXPECT_EQ(all[1].first_column, 1);
  EXPECT_EQ(all[1].range_at_10_percent_m, 60);
  EXPECT_EQ(all[1].min_range_m, 1.4);
  const auto some = config::read_channels(
      folder.write("some.csv", header + ",first_column,min_range_m\n1,-1,,,0,0\n"));
  EXPECT_EQ(some[0].min_range_m, 0);
}

TEST(channel_table, names_the_wrong_cell_of_an_optional_column) {
  const std::string header = kHeader.substr(0, kHeader.size() - 1);
  const auto expect = [&](const std::string& column, const std::string& value,
                          const std::string& what) {
    expect_channels_error(header + "," + column + "\n1,0,,," + value + "\n", 2, column, what);
  };
  expect("column_step", "0", "expected 1 or more");
  expect("column_step", "1.5", "a whole number");
  expect("column_step", "17", "16");
  expect("first_column", "1", "expected below column_step, got 1");
  expect("range_at_10_percent_m", "0", "above 0");
  expect("range_at_10_percent_m", "2001", "2000");
  expect("min_range_m", "-1", "'-1'");
  for (const char* columns : {",range_m", ",min_range_m,column_step", ",min_range_m,min_range_m"})
    expect_channels_error(header + columns + "\n", 1, "(header)", "then any of 'column_step,");
}

TEST(channel_table, has_steps_with_a_short_common_multiple) {
  const TestFolder folder;
  const auto file = folder.write("lidar.yaml", kLidar);
  const std::string header = kHeader.substr(0, kHeader.size() - 1) + ",column_step\n";
  folder.write("two.csv", header + "1,0,0,0,2\n2,1,0,0,8\n");
  EXPECT_NO_THROW(read_lidar(file, "table"));
  folder.write("two.csv", header + "1,0,0,0,3\n2,1,0,0,7\n");
  EXPECT_NE(error_of([&] { read_lidar(file, "table"); }).find("column_step: expected steps with"),
            std::string::npos);
}

TEST(channel_table, of_every_committed_file_is_read) {
  for (const auto& entry : std::filesystem::directory_iterator(configs() / "lidars" / "channels"))
    EXPECT_GE(config::read_channels(entry.path()).size(), 16U) << entry.path();
}

TEST(channel_table, a_fire_time_beyond_its_column_is_an_error) {
  const TestFolder folder;
  const auto file = folder.write("lidar.yaml", kLidar);
  folder.write("two.csv", kHeader + "1,0,0,0\n2,1,0,55.5\n");
  EXPECT_NO_THROW(read_lidar(file, "table"));
  folder.write("two.csv", kHeader + "1,0,0,0\n2,1,0,55.6\n");  // a column takes 55.56 us
  const std::string message = error_of([&] { read_lidar(file, "table"); });
  EXPECT_NE(message.find("fire_time_us: expected below 55.55"), std::string::npos) << message;
}

// --- tables of directions ---------------------------------------------------------------------

std::string npy(const std::string& type, const std::string& shape, const std::string& order,
                const std::string& data) {
  std::string header =
      "{'descr': '" + type + "', 'fortran_order': " + order + ", 'shape': " + shape + ", }\n";
  std::string bytes("\x93NUMPY\x01\x00", 8);
  bytes += static_cast<char>(header.size());
  bytes += '\0';
  return bytes + header + data;
}

template <class T>
std::string bytes_of(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

TEST(direction_table, is_read_from_float32_float64_and_csv) {
  const TestFolder folder;
  const std::vector<double> wide{0.5, -0.25, 1, 0};
  const std::vector<float> narrow{0.5F, -0.25F, 1, 0};
  write_npy(folder.path() / "a.npy", wide, 2);
  folder.write("b.npy", npy("<f4", "(2, 2)", "False", bytes_of(narrow)));
  folder.write("c.csv", "azimuth_rad,elevation_rad\n0.5,-0.25\n1,0\n");
  for (const char* name : {"a.npy", "b.npy", "c.csv"}) {
    SCOPED_TRACE(name);
    const auto rows = config::read_firing_table(folder.path() / name).directions;
    ASSERT_EQ(rows.size(), 2U);
    EXPECT_EQ(rows[0].x, 0.5);
    EXPECT_EQ(rows[0].y, -0.25);
    EXPECT_EQ(rows[1].x, 1);
  }
}

TEST(direction_table, in_another_layout_is_an_error) {
  const std::string two_rows = bytes_of(std::vector<double>(4, 0.5));
  const TestFolder folder;
  const auto expect = [&](const std::string& bytes, const std::string& what) {
    SCOPED_TRACE(what);
    const auto file = folder.write("table.npy", bytes);
    const std::string message = error_of([&] { config::read_firing_table(file); });
    EXPECT_TRUE(message.starts_with(file.string() + ":")) << message;
    EXPECT_NE(message.find(what), std::string::npos) << message;
  };
  expect(npy("<i8", "(2, 2)", "False", two_rows), "got type '<i8'");
  expect(npy(">f8", "(2, 2)", "False", two_rows), "got type '>f8'");
  expect(npy("<f8", "(4,)", "False", two_rows), "got shape (4,)");
  expect(npy("<f8", "(1, 4)", "False", two_rows), "got shape (1, 4)");
  expect(npy("<f8", "(1, 2, 2)", "False", two_rows), "got shape (1, 2, 2)");
  expect(npy("<f8", "(2, 2)", "True", two_rows), "Fortran");
  expect(npy("<f8", "(2, 2)", "False", two_rows.substr(1)), "size");
  expect(npy("<f8", "(2, 2)", "False", two_rows + "x"), "size");
  expect(npy("<f8", "(99999999999999999999, 2)", "False", two_rows), "shape");
  expect(npy("<f8", "(1152921504606846976, 2)", "False", two_rows), "does not match the size");
  expect(npy("<f8", "(-2, 2)", "False", two_rows), "shape (-2, 2)");
  expect(npy("<f8", "(2, 2", "False", two_rows), "shape (2, 2");
  expect(npy("<f8", "(2, 2)", "False", two_rows).substr(0, 40), "without a complete NumPy header");
  std::string without_shape = npy("<f8", "(2, 2)", "False", two_rows);
  expect(without_shape.replace(without_shape.find("shape"), 5, "forms"), "got shape ");
  std::string other_version = npy("<f8", "(2, 2)", "False", two_rows);
  other_version[6] = '\x09';
  expect(other_version, "version 1 to 3");
  expect("azimuth_rad,elevation_rad\n", "NumPy");
  expect("", "NumPy");
  expect(npy("<f8", "(0, 2)", "False", ""), "one or more rows");
}

TEST(direction_table, that_is_not_finite_is_an_error_that_names_the_row) {
  const TestFolder folder;
  std::vector<double> values{0, 0, 0, std::numeric_limits<double>::quiet_NaN()};
  const auto file = folder.write("table.npy", npy("<f8", "(2, 2)", "False", bytes_of(values)));
  EXPECT_NE(error_of([&] { config::read_firing_table(file); }).find("row 1"), std::string::npos);
  const auto csv = folder.write("table.csv", "azimuth_rad,elevation_rad\n0,0\n0,nan\n");
  expect_message(error_of([&] { config::read_firing_table(csv); }), csv, 3, "elevation_rad",
                 "'nan'");
}

TEST(direction_table, in_degrees_and_with_times_is_that_in_radians) {
  const TestFolder folder;
  write_npy(folder.path() / "a.npy", std::vector<double>{kPi / 6, -kPi / 4, 3, kPi, 0, 5}, 3);
  folder.write("b.csv", "azimuth_deg,elevation_deg,time_s\n30,-45,0\n180,0,2\n");
  folder.write("c.csv", "azimuth_deg,elevation_deg\n30,-45\n180,0\n");
  folder.write("d.csv",
               "\xEF\xBB\xBF"
               "azimuth_deg,elevation_deg,time_s\n30,-45,0\n180,0,2\n");
  for (const char* name : {"a.npy", "b.csv", "c.csv", "d.csv"}) {
    SCOPED_TRACE(name);
    const config::FiringTable table = config::read_firing_table(folder.path() / name);
    ASSERT_EQ(table.directions.size(), 2U);
    EXPECT_NEAR(table.directions[0].x, kPi / 6, 1e-15);
    EXPECT_NEAR(table.directions[0].y, -kPi / 4, 1e-15);
    EXPECT_NEAR(table.directions[1].x, kPi, 1e-15);
    const bool timed = std::string(name) != "c.csv";
    EXPECT_EQ(table.times_s, timed ? std::vector<double>({0, 2}) : std::vector<double>());
  }
}

TEST(direction_table, whose_times_fall_is_an_error_at_its_row) {
  const TestFolder folder;
  const auto csv = folder.write("t.csv", "azimuth_rad,elevation_rad,time_s\n0,0,1\n0,0,0.5\n");
  expect_message(error_of([&] { config::read_firing_table(csv); }), csv, 3, "time_s", "0.5");
  write_npy(folder.path() / "t.npy", std::vector<double>{0, 0, 1, 0, 0, 0.5}, 3);
  const std::string message = error_of([&] { config::read_firing_table(folder.path() / "t.npy"); });
  EXPECT_NE(message.find("row 1"), std::string::npos) << message;
}

TEST(direction_table, says_the_rate_by_its_times_or_the_file_must) {
  const TestFolder folder;
  const auto read = [&](const std::string& rate) {
    return read_lidar(folder.write("lidar.yaml", R"(name: listed
price_usd: {low: 1, high: 1, source: nobody, date: "2025"}
pattern: {table: {file: table.csv)" + rate + R"(}}
returns: {max_range_m: 10}
)"),
                      "")
        .units.front()
        .pattern.table->rays_per_s;
  };
  folder.write("table.csv", "azimuth_deg,elevation_deg,time_s\n0,0,0\n1,0,0.01\n2,0,0.04\n");
  EXPECT_DOUBLE_EQ(read(""), 50);
  EXPECT_DOUBLE_EQ(read(", rays_per_s: 30"), 30);
  EXPECT_NE(error_of([&] { read(", rays_per_s: 80"); }).find("expected below 75"),
            std::string::npos);
  folder.write("table.csv", "azimuth_deg,elevation_deg\n0,0\n1,0\n");
  EXPECT_NE(error_of([&] { read(""); }).find("rays_per_s"), std::string::npos);
}

TEST(direction_table, that_changed_since_a_run_is_an_error) {
  const TestFolder folder;
  const auto file = folder.write("lidar.yaml", R"(name: listed
price_usd: {low: 1, high: 1, source: nobody, date: "2025"}
pattern: {table: {file: table.csv, rays_per_s: 100}}
returns: {max_range_m: 10}
)");
  folder.write("table.csv", "azimuth_rad,elevation_rad\n0,0\n0,0.1\n");
  const auto resolved = folder.write("resolved.yaml", dump_lidar(read_lidar(file, "")));
  EXPECT_NO_THROW(read_lidar(resolved, ""));
  folder.write("table.csv", "azimuth_rad,elevation_rad\n0,0\n0,0.2\n");
  EXPECT_NE(error_of([&] { read_lidar(resolved, ""); }).find("digest"), std::string::npos);
}

// --- bundles ----------------------------------------------------------------------------------

TEST(bundle, adds_prices_and_turns_its_parts) {
  const TestFolder folder;
  folder.write("part.yaml", kLidar);
  const auto file = folder.write("bundle.yaml", R"(name: pair
bundle:
  - {lidar: part.yaml, yaw_deg: 35}
  - {lidar: part.yaml, yaw_deg: -35, pitch_deg: 5}
)");
  const LidarConfig lidar = read_lidar(file, "even");
  ASSERT_EQ(lidar.units.size(), 2U);
  EXPECT_EQ(lidar.units[0].yaw_deg, 35);
  EXPECT_EQ(lidar.units[1].pitch_deg, 5);
  EXPECT_EQ(lidar.price_usd.low, 2);
  EXPECT_EQ(lidar.price_usd.high, 4);
}

TEST(bundle, of_one_turned_unit_is_dumped_with_its_turn_and_reads_back) {
  const TestFolder folder;
  folder.write("part.yaml",
               replaced(kLidar, "rate_hz: 10,", "rate_hz: 10, phase: free, cut_angle_deg: 35,"));
  for (const char* turn : {"pitch_deg: 10", "yaw_deg: -35", "yaw_deg: 35, pitch_deg: -5"}) {
    SCOPED_TRACE(turn);
    const auto file = folder.write(
        "bundle.yaml", std::string("name: turned\nbundle: [{lidar: part.yaml, ") + turn + "}]\n");
    const LidarConfig lidar = read_lidar(file, "even");
    const std::string dumped = dump_lidar(lidar);
    const LidarConfig back = read_lidar(folder.write("dumped.yaml", dumped), "even");
    EXPECT_EQ(dump_lidar(back), dumped);
    ASSERT_EQ(back.units.size(), 1U);
    const LidarUnit &a = lidar.units.front(), &b = back.units.front();
    EXPECT_TRUE(a.yaw_deg != 0 || a.pitch_deg != 0);
    EXPECT_EQ(a.yaw_deg, b.yaw_deg);
    EXPECT_EQ(a.pitch_deg, b.pitch_deg);
    EXPECT_EQ(b.pattern.spinning->channels.table.size(), 2U);
    EXPECT_EQ(b.returns.range_accuracy_m, 0.02);
    EXPECT_EQ(back.name, "turned");
    EXPECT_EQ(back.units.front().pattern.spinning->phase, MotorPhase::kFree);
    EXPECT_EQ(back.units.front().pattern.spinning->cut_angle_deg, 35);
    EXPECT_EQ(back.price_usd.high, 2);
    EXPECT_EQ(back.price_usd.source, "nobody");
  }
}

TEST(bundle, of_several_units_is_dumped_with_its_price_and_reads_back) {
  const TestFolder folder;
  folder.write("part.yaml", kLidar);
  const LidarConfig lidar =
      read_lidar(folder.write("bundle.yaml",
                              "name: pair\nbundle: [{lidar: part.yaml, yaw_deg: 35}, "
                              "{lidar: part.yaml, yaw_deg: -35}]\n"),
                 "even");
  const std::string dumped = dump_lidar(lidar);
  const LidarConfig back = read_lidar(folder.write("dumped.yaml", dumped), "even");
  EXPECT_EQ(dump_lidar(back), dumped);
  EXPECT_EQ(back.units.size(), 2U);
  EXPECT_EQ(back.price_usd.high, 4);
  // Folders of earlier versions have no price of a bundle, and stay the same data set.
  EXPECT_EQ(canonical_lidar(lidar).find("price_usd"), std::string::npos);
}

TEST(lidar_file, says_how_its_motors_start) {
  const TestFolder folder;
  const auto file = folder.write("lidar.yaml", kLidar);
  const SpinningConfig plain = *read_lidar(file, "even").units.front().pattern.spinning;
  EXPECT_EQ(plain.phase, MotorPhase::kLocked);
  EXPECT_EQ(plain.cut_angle_deg, 180);
  expect_lidar_error("rate_hz: 10,", "rate_hz: 10, phase: random, #!\n   ",
                     "pattern.spinning.phase", "expected locked, free, got 'random'");
  expect_lidar_error("rate_hz: 10,", "rate_hz: 10, cut_angle_deg: 400, #!\n   ",
                     "pattern.spinning.cut_angle_deg", "expected -360 to 360");
}

TEST(scene, labels_as_the_preset_does_unless_it_says_otherwise) {
  SceneConfig scene;
  EXPECT_EQ(label_time_of(scene, "paper"), LabelTime::kFrame);
  EXPECT_EQ(label_time_of(scene, "equal"), LabelTime::kFrame);
  EXPECT_EQ(label_time_of(scene, "datasheet"), LabelTime::kScan);
  EXPECT_EQ(label_time_of(scene, "an_own_one"), LabelTime::kScan);
  scene.label_time = LabelTime::kFrame;
  EXPECT_EQ(label_time_of(scene, "datasheet"), LabelTime::kFrame);
  EXPECT_NE(dump_scene(scene).find("\nlabel_time: frame\n"), std::string::npos);
}

TEST(bundle, of_one_unit_that_is_not_turned_is_dumped_as_that_unit) {
  const TestFolder folder;
  const auto part = folder.write("part.yaml", kLidar);
  const auto file =
      folder.write("bundle.yaml", "name: two\nmodel: Two lines\nbundle: [{lidar: part.yaml}]\n");
  EXPECT_EQ(dump_lidar(read_lidar(file, "even")), dump_lidar(read_lidar(part, "even")));
}

TEST(bundle, dumps_the_path_of_a_table_in_another_folder_as_it_reads_it) {
  const TestFolder folder;
  std::filesystem::create_directory(folder.path() / "parts");
  folder.write("parts/table.csv", "azimuth_rad,elevation_rad\n0,0\n0,0.1\n");
  folder.write("parts/part.yaml", R"(name: listed
price_usd: {low: 1, high: 1, source: nobody, date: "2025"}
pattern: {table: {file: table.csv, rays_per_s: 100}}
returns: {max_range_m: 10}
)");
  const auto file = folder.write(
      "bundle.yaml", "name: turned\nbundle: [{lidar: parts/part.yaml, pitch_deg: 10}]\n");
  const auto dumped = folder.write("dumped.yaml", dump_lidar(read_lidar(file, "")));
  EXPECT_EQ(read_lidar(dumped, "").units.front().pattern.table->directions.size(), 2U);
}

TEST(bundle, entry_is_a_file_or_a_whole_unit) {
  const std::string pattern = "pattern: {table: {file: table.csv, rays_per_s: 100}}";
  const std::string returns = "returns: {max_range_m: 10}";
  const TestFolder folder;
  for (const std::string& entry :
       {std::string("yaw_deg: 1"), std::string("lidar: ''"), pattern, returns,
        "lidar: part.yaml, " + returns, "lidar: part.yaml, " + pattern + ", " + returns}) {
    SCOPED_TRACE(entry);
    const auto file = folder.write("bundle.yaml", "name: pair\nbundle:\n  - {" + entry + "}\n");
    expect_message(error_of([&] { read_lidar(file, ""); }), file, 3, "bundle.0.lidar",
                   "expected a LiDAR file, or pattern and returns");
  }
}

TEST(bundle, has_a_price_of_its_own_if_and_only_if_it_names_no_files) {
  const std::string price = "price_usd: {low: 1, high: 1, source: nobody, date: '2025'}\n";
  const std::string file_entry = "{lidar: part.yaml}";
  const std::string whole_entry =
      "{pattern: {table: {file: table.csv, rays_per_s: 100}}, returns: {max_range_m: 10}}";
  const TestFolder folder;
  folder.write("table.csv", "azimuth_rad,elevation_rad\n0,0\n");
  const auto with = [&](const std::string& more, const std::string& entries) {
    return folder.write("bundle.yaml", "name: pair\n" + more + "bundle: [" + entries + "]\n");
  };
  EXPECT_EQ(read_lidar(with(price, whole_entry + ", " + whole_entry), "").units.size(), 2U);
  for (const auto& file :
       {with("", whole_entry), with(price, file_entry), with("", file_entry + ", " + whole_entry)})
    EXPECT_NE(error_of([&] { read_lidar(file, ""); }).find("price_usd"), std::string::npos);
}

TEST(bundle, in_a_bundle_is_an_error) {
  const TestFolder folder;
  folder.write("part.yaml", kLidar);
  folder.write("inner.yaml", "name: inner\nbundle:\n  - {lidar: part.yaml}\n");
  const auto outer = folder.write("outer.yaml", "name: outer\nbundle:\n  - {lidar: inner.yaml}\n");
  const auto self = folder.write("self.yaml", "name: self\nbundle:\n  - {lidar: self.yaml}\n");
  for (const auto& file : {outer, self})
    EXPECT_NE(error_of([&] { read_lidar(file, "even"); }).find("bundle"), std::string::npos);
}

TEST(bundle, with_a_pattern_of_its_own_is_an_error) {
  expect_lidar_error("presets:\n", "bundle: [{lidar: part.yaml}] #!\npresets:\n", "bundle",
                     "only a bundle");
}

}  // namespace
}  // namespace infrasim
