#include "infrasim/pipeline/static_layer_file.h"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>

#include "infrasim/core/classes.h"
#include "infrasim/io/kitti.h"
#include "infrasim/pipeline/simulate.h"
#include "infrasim/pipeline/static_recording.h"
#include "infrasim/pipeline/static_units.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using namespace testing;

constexpr std::size_t kHeader = std::string_view("infrasim-static-layer 2\n").size();
constexpr std::size_t kUnits = kHeader + 7 * 8;  // position of the number of units

World crossroad(const std::vector<std::string>& assignments, const std::string& preset) {
  std::vector<std::string> all{"duration_s=5", "traffic.warm_up_s=20"};
  all.insert(all.end(), assignments.begin(), assignments.end());
  return build_world(read_scene(configs() / "scenes/crossroad.yaml", all, preset));
}

/// Gives a world the static layer of a LiDAR, as if it had been read from a file.
void give_layer(World& world, const LidarConfig& lidar, const std::vector<StaticHits>& units) {
  world.static_layers.emplace(
      lidar.name, static_layer_from_bytes(static_layer_to_bytes({}, units), "given.layer"));
}

void expect_same_frames(const World& a, const World& b, const LidarConfig& lidar) {
  FrameSimulator first(a, std::array{lidar}), second(b, std::array{lidar});
  for (const int k : {0, 1, 17, 40}) {
    const Frame left = first.simulate(k, {true})[0], right = second.simulate(k, {true})[0];
    EXPECT_GT(left.cloud.size(), 1000U);
    expect_equal(left.cloud, right.cloud);
    ASSERT_EQ(left.objects.size(), right.objects.size());
    for (std::size_t i = 0; i < left.objects.size(); ++i)
      EXPECT_EQ(left.objects[i].points, right.objects[i].points);
  }
}

TEST(static_layer_file, gives_the_frames_of_the_scene_it_was_cast_in) {
  for (const char* preset : {"equal", "datasheet"})
    for (const char* name : {"ruby_plus", "velodyne_hdl_64e"}) {
      SCOPED_TRACE(std::string(name) + ", " + preset);
      const LidarConfig lidar = shipped(name, preset);
      const World world = crossroad({}, preset);
      World given = crossroad({}, preset);
      give_layer(given, lidar, cast_static_layer(world, lidar));
      expect_same_frames(world, given, lidar);
    }
}

TEST(static_layer_file, stands_for_a_world_that_is_not_there) {
  // Rays behind panes, and a learnt background, use the layer too.
  const std::vector<std::string> whole{"filters=[{background: {frames: 3}}]", "vegetation=[]"};
  std::vector<std::string> bare = whole;
  bare.insert(bare.end(), {"ground=[]", "buildings=[]", "barriers=[]", "gantries=[]"});
  const LidarConfig lidar = shipped("ruby_plus");
  const World world = crossroad(whole, "datasheet");
  World given = crossroad(bare, "datasheet");
  EXPECT_LT(given.background().triangles.size(), world.background().triangles.size());
  give_layer(given, lidar, cast_static_layer(world, lidar));
  expect_same_frames(world, given, lidar);
}

TEST(static_layer_file, is_refused_for_lidars_that_it_is_not_of) {
  const World world = crossroad({}, "datasheet");
  const LidarConfig ruby = shipped("ruby_plus");
  const std::vector<StaticHits> units = cast_static_layer(world, ruby);
  const auto refused = [&](LidarConfig lidar, const std::vector<std::string>& set = {}) {
    World given = crossroad(set, "datasheet");
    lidar.name = "ruby_plus";
    give_layer(given, lidar, units);
    return error_of([&] { make_static_layers(given, std::array{lidar}); });
  };
  const auto says = [](const std::string& message, const char* what) {
    EXPECT_TRUE(message.starts_with("given.layer: unit")) << message;
    EXPECT_NE(message.find(what), std::string::npos) << message;
  };
  says(refused(shipped("pandar_64")), "expected 1800 groups of 64 rays, as ruby_plus, preset");
  says(refused(shipped("ruby_plus", "equal")), "unit 0: max_range_m: expected 260, as");
  LidarConfig recut = ruby;
  recut.units[0].pattern.spinning->cut_angle_deg = 90;
  says(refused(recut), "unit 0: directions");
  says(refused(ruby, {"mounts.pole.pitch_deg=1"}), "unit 0: directions");
  LidarConfig twice = ruby;
  twice.units.push_back(ruby.units[0]);
  says(refused(twice), "units: expected 2, as");
}

/// A scene on disk, with a static layer that is cast in the scene or made from a recording.
class LayerOnDisk {
 public:
  explicit LayerOnDisk(bool recording) {
    const LidarConfig lidar = shipped("ruby_plus");
    const World world = crossroad({}, "datasheet");
    LayerOrigin origin = layer_origin(world.scene, world.background());
    if (recording) origin.scene = 0;
    const std::vector<ScannerUnit> scanners = make_scanner_units(world.scene, lidar);
    folder_.write("a.layer", static_layer_to_bytes(origin, units_without_hits(lidar, scanners)));
  }
  World build(std::vector<std::string> assignments) const {
    const std::string file = (folder_.path() / "a.layer").string();
    assignments.insert(assignments.begin(), {"traffic.warm_up_s=0", "duration_s=0.2",
                                             "static_layers={ruby_plus: " + file + "}"});
    World world = crossroad(assignments, "datasheet");
    make_static_layers(world, std::array{shipped("ruby_plus")});
    return world;
  }
  std::string refusal(const std::vector<std::string>& assignments) const {
    return error_of([&] { build(assignments); });
  }

 private:
  TestFolder folder_;
};

TEST(static_layer_file, is_refused_at_another_mount) {
  for (const bool recording : {false, true})
    for (const std::string key : {"x_m", "y_m", "z_m", "yaw_deg", "pitch_deg", "roll_deg"}) {
      const LayerOnDisk layer(recording);
      EXPECT_NE(
          layer.refusal({"mounts.pole." + key + "=7.5"}).find(": mounts." + key + ": expected"),
          std::string::npos);
    }
}

TEST(static_layer_file, is_refused_where_other_things_stand_unless_it_is_of_a_recording) {
  const LayerOnDisk cast(false), recorded(true);
  for (const std::string still :
       {"ground=[]", "vegetation=[]", "gantries=[{road: main, s_m: 200}]",
        "buildings=[{x_m: 40, y_m: 40, length_m: 9, width_m: 9, height_m: 9}]",
        "barriers=[{road: main, offset_m: 12, to_m: 200}]", "roads.0.lanes.sidewalk_m=2"}) {
    SCOPED_TRACE(still);
    EXPECT_NE(cast.refusal({still}).find("buildings"), std::string::npos);
    EXPECT_NO_THROW(recorded.build({still}));
  }
  for (const std::string else_ : {"seed=9", "traffic.vehicles_per_km_lane=3", "detail=box",
                                  "weather.rain_mm_per_h=5", "duration_s=1", "filters=[]"})
    EXPECT_NO_THROW(cast.build({else_})) << else_;
}

TEST(static_layer_file, of_the_first_version_is_refused_as_it_has_no_mount) {
  const std::string message =
      error_of([] { static_layer_from_bytes("infrasim-static-layer 1\n and more", "old.layer"); });
  EXPECT_TRUE(message.starts_with("old.layer: byte 0: expected a static layer of version 2"))
      << message;
}

TEST(static_layer_file, is_refused_for_lidars_without_a_layer) {
  const World world = crossroad({}, "datasheet");
  EXPECT_NE(error_of([&] {
              cast_static_layer(world, shipped("livox_avia", "equal"));
            }).find("livox_avia, preset equal: unit 0: expected a pattern of single rays"),
            std::string::npos);
  LidarConfig wide = shipped("ruby_plus");
  wide.units[0].returns.beam.emplace().where = BeamWhere::kEverywhere;
  EXPECT_NE(error_of([&] { cast_static_layer(world, wide); }).find("sub-rays everywhere"),
            std::string::npos);
}

/// Returns the hits of two units with 2 groups of 3 rays. Each unit has one hit.
std::vector<StaticHits> small_units() {
  StaticHits unit;
  unit.groups = 2;
  unit.group_size = 3;
  unit.max_range_m = 50;
  unit.directions = 77;
  unit.range_m.assign(6, std::numeric_limits<float>::infinity());
  unit.range_m[4] = 12.5F;
  unit.gain.assign(6, 0);
  unit.gain[4] = 0.25F;
  unit.class_id.assign(6, 0);
  unit.class_id[4] = static_cast<std::uint16_t>(Class::kRecorded);
  return {unit, unit};
}

TEST(static_layer_file, reads_back_what_was_written) {
  const LayerOrigin origin{{1, 2, 6, 90, 5, -0.5}, 99};
  const std::string bytes = static_layer_to_bytes(origin, small_units());
  EXPECT_EQ(bytes.size(), kUnits + 4 + 2 * (20 + 6 * 10));
  const StaticLayerFile file = static_layer_from_bytes(bytes, "a.layer");
  EXPECT_EQ(static_layer_to_bytes(file.origin, file.units), bytes);
  EXPECT_EQ(file.origin.mount, origin.mount);
  EXPECT_EQ(file.origin.scene, 99U);
  ASSERT_EQ(file.units.size(), 2U);
  EXPECT_EQ(file.units[1].range_m[4], 12.5F);
  EXPECT_EQ(file.units[1].directions, 77U);
  EXPECT_EQ(file.digest.size(), 16U);
}

TEST(static_layer_file, that_is_damaged_is_an_error_with_its_place) {
  const std::string whole = static_layer_to_bytes({}, small_units());
  const std::size_t data = kUnits + 4 + 2 * 20;
  const auto message = [](const std::string& bytes) {
    return error_of([&] { static_layer_from_bytes(bytes, "a.layer"); });
  };
  for (std::size_t size = 0; size < whole.size(); ++size)
    EXPECT_TRUE(message(whole.substr(0, size)).starts_with("a.layer: byte "));
  EXPECT_NE(message(whole + "x").find("expected the end of the file, got 1 bytes more"),
            std::string::npos);
  const auto with = [&](std::size_t at, auto value) {
    std::string bytes = whole;
    std::memcpy(&bytes[at], &value, sizeof value);
    return message(bytes);
  };
  EXPECT_EQ(
      with(data + 4, std::numeric_limits<float>::quiet_NaN()),
      "a.layer: byte " + std::to_string(data + 4) + ": range_m: expected 0 to 50, or inf, got nan");
  EXPECT_NE(with(data, -3.0F).find("range_m: expected 0 to 50, or inf, got -3"), std::string::npos);
  EXPECT_NE(with(data, 51.0F).find("range_m: expected 0 to 50, or inf, got 51"), std::string::npos);
  EXPECT_NE(with(data + 24, 1.5F).find("cos_incidence: expected 0 to 1, got 1.5"),
            std::string::npos);
  EXPECT_NE(with(data + 48, std::uint16_t{10}).find("class: expected 0 to 5, got 10"),
            std::string::npos);
  EXPECT_NE(
      with(kHeader + 16, std::numeric_limits<double>::quiet_NaN()).find("z_m: expected a fin"),
      std::string::npos);
  EXPECT_NE(with(kUnits, 0).find("units: expected 1 to 1024, got 0"), std::string::npos);
  EXPECT_NE(with(kUnits + 12, -1).find("groups: expected 1 to"), std::string::npos);
  EXPECT_NE(with(kUnits + 12, 1 << 30).find("expected"), std::string::npos);
  EXPECT_NE(with(kUnits + 16, 70000).find("rays of a group: expected 1 to"), std::string::npos);
  EXPECT_NE(with(kUnits + 20, -1.0F).find("max_range_m: expected above 0"), std::string::npos);
}

/// Returns a scene with a road without vehicles, a house beside it, and level ground.
SceneConfig empty_site() {
  SceneConfig scene = empty_road();
  scene.duration_s = 4;
  scene.ground.push_back(ground_at(-0.05));
  BuildingConfig& house = scene.buildings.emplace_back();
  house.x_m = 20;
  house.y_m = 25;
  house.length_m = 15;
  house.width_m = 10;
  house.height_m = 8;
  return scene;
}

/// Returns a LiDAR with range noise, whose far returns are detected with some probability.
LidarConfig noisy_lidar() {
  PatternConfig pattern = spinning(16, -24, 3, 1);
  pattern.spinning->azimuth_step_deg.reset();
  pattern.spinning->columns_per_turn = Fraction{450, 1};
  LidarConfig lidar = plain_lidar("noisy", pattern);
  lidar.preset = "datasheet";
  lidar.units[0].returns.range_accuracy_m = 0.03;
  lidar.units[0].returns.detection.emplace().range_at_10_percent_m = 60;
  return lidar;
}

/// Writes frames of a world as a recording.
void record(const World& world, const LidarConfig& lidar, int frames,
            const std::filesystem::path& folder) {
  FrameSimulator simulator(world, std::array{lidar});
  create_frame_folders(folder, true);
  for (int k = 0; k < frames; ++k)
    write_frame(folder, k, simulator.simulate(k, {true})[0], {.point_fields = true});
}

/// Returns two numbers: the rays of a recorded layer whose ranges agree with those of cast rays
/// within three standard deviations of a return's noise, and the rays with a hit in the recording.
std::pair<int, int> agreement(const StaticHits& recorded, const StaticHits& cast) {
  int agree = 0, hits = 0;
  for (std::size_t i = 0; i < recorded.range_m.size(); ++i) {
    if (!std::isfinite(recorded.range_m[i])) continue;
    ++hits;
    agree += std::abs(recorded.range_m[i] - cast.range_m[i]) <= 3 * 0.03 / std::sqrt(2);
    EXPECT_EQ(recorded.class_id[i], static_cast<std::uint16_t>(Class::kRecorded));
  }
  return {agree, hits};
}

TEST(recorded_layer, is_what_the_recording_saw) {
  const TestFolder folder;
  const LidarConfig lidar = noisy_lidar();
  const World world = build_world(empty_site());
  record(world, lidar, 24, folder.path());
  const RecordedLayer layer = recorded_static_layer(world.scene, lidar, folder.path());
  EXPECT_EQ(layer.frames, 24);
  EXPECT_LT(layer.elevation_miss_deg, 0.001);
  EXPECT_NEAR(layer.azimuth_offsets_deg.at(0), 0, 0.001);
  const auto cast = cast_static_layer(world, lidar);
  const auto [agree, hits] = agreement(layer.units[0], cast[0]);
  EXPECT_EQ(agree, hits);
  EXPECT_GT(hits, 2500);
}

TEST(recorded_layer, places_points_by_their_azimuth_and_finds_the_offset_of_the_columns) {
  const TestFolder folder;
  const LidarConfig lidar = noisy_lidar();
  const World world = build_world(empty_site());
  LidarConfig turned =
      lidar;  // another cut angle, so that the columns are shifted by a third of a column
  turned.units[0].pattern.spinning->cut_angle_deg = 90 * 0.8 + 0.8 / 3;
  record(world, turned, 24, folder.path());
  const RecordedLayer layer = recorded_static_layer(world.scene, lidar, folder.path());
  EXPECT_NEAR(layer.azimuth_offsets_deg.at(0), 0.8 / 3, 0.001);
  // Each ray has the recorded hit a third of a column beside it, which is 90 columns later in the
  // turn.
  StaticHits cast = cast_static_layer(world, turned)[0];
  std::ranges::rotate(cast.range_m, cast.range_m.begin() + 90 * cast.group_size);
  const auto [agree, hits] = agreement(layer.units[0], cast);
  EXPECT_GT(hits, 2500);
  EXPECT_EQ(agree, hits);
}

TEST(recorded_layer, outvotes_vehicles_that_pass) {
  const TestFolder folder;
  const LidarConfig lidar = noisy_lidar();
  SceneConfig busy = empty_site();
  busy.traffic->vehicles_per_km_lane = 20;
  busy.traffic->speed = {.mean_km_h = 90, .std_km_h = 0};
  const World world = build_world(busy);
  record(world, lidar, 40, folder.path());
  const RecordedLayer layer = recorded_static_layer(busy, lidar, folder.path());
  const auto [agree, hits] = agreement(layer.units[0], cast_static_layer(world, lidar)[0]);
  EXPECT_GT(hits, 2500);
  EXPECT_GT(agree, 0.99 * hits);
}

TEST(recorded_layer, takes_vehicles_as_the_whole_scene_does) {
  const TestFolder folder;
  const LidarConfig lidar = noisy_lidar();
  record(build_world(empty_site()), lidar, 24, folder.path());
  SceneConfig busy = empty_site();
  busy.traffic->vehicles_per_km_lane = 20;
  busy.traffic->warm_up_s = 20;
  const World whole = build_world(busy);
  busy.ground.clear();
  busy.buildings.clear();
  World bare = build_world(busy);
  give_layer(bare, lidar, recorded_static_layer(busy, lidar, folder.path()).units);
  FrameSimulator a(whole, std::array{lidar}), b(bare, std::array{lidar});
  int points = 0, same = 0;
  for (int k = 0; k < 20; ++k) {
    const Frame left = a.simulate(k, {true})[0], right = b.simulate(k, {true})[0];
    ASSERT_EQ(left.objects.size(), right.objects.size());
    for (std::size_t i = 0; i < left.objects.size(); ++i) {
      points += left.objects[i].points;
      same += std::min(left.objects[i].points, right.objects[i].points);
    }
  }
  EXPECT_GT(points, 1000);
  EXPECT_GE(same, 0.999 * points);  // the noise of the road may hide the lower end of a wheel
}

TEST(recorded_layer, is_not_lost_again) {
  const TestFolder folder;
  const LidarConfig lidar = noisy_lidar();
  const World world = build_world(empty_site());
  record(world, lidar, 24, folder.path());
  World given = build_world(empty_site());
  const RecordedLayer layer = recorded_static_layer(world.scene, lidar, folder.path());
  give_layer(given, lidar, layer.units);
  const auto hits = std::ranges::count_if(layer.units[0].range_m,
                                          [](float range) { return std::isfinite(range); });
  FrameSimulator simulator(given, std::array{lidar});
  for (int k = 0; k < 5; ++k) {
    const Frame frame = simulator.simulate(k, {true})[0];
    EXPECT_EQ(std::ssize(frame.cloud.class_id), hits);
    for (const std::uint16_t c : frame.cloud.class_id)
      EXPECT_EQ(c, static_cast<std::uint16_t>(Class::kRecorded));
  }
}

TEST(recorded_layer, is_refused_where_it_does_not_fit) {
  const TestFolder folder;
  const LidarConfig lidar = noisy_lidar();
  const World world = build_world(empty_site());
  record(world, lidar, 20, folder.path());
  const auto message = [&](const SceneConfig& scene, const LidarConfig& other) {
    return error_of([&] { recorded_static_layer(scene, other, folder.path()); });
  };
  SceneConfig leaning = world.scene;
  leaning.mounts["pole"].roll_deg = 2;
  EXPECT_NE(message(leaning, lidar).find("degrees of those of noisy"), std::string::npos);
  LidarConfig fewer = lidar;
  fewer.units[0].pattern.spinning->channels.table.pop_back();
  EXPECT_NE(message(world.scene, fewer).find("ring: expected the number of a laser"),
            std::string::npos);
  EXPECT_NE(message(world.scene, shipped("livox_avia")).find("got a"), std::string::npos);
  for (const float intensity : {200.0F, -0.1F, std::numeric_limits<float>::quiet_NaN()}) {
    FrameSimulator simulator(world, std::array{lidar});
    Frame frame = std::move(simulator.simulate(3, {true})[0]);
    frame.cloud.intensity[5] = intensity;
    write_frame(folder.path(), 3, frame, {.point_fields = true});
    EXPECT_NE(message(world.scene, lidar)
                  .find(folder.path().string() +
                        ": frame 000003, point 5: intensity: expected 0 to 1, got " +
                        (intensity > 0   ? "200"
                         : intensity < 0 ? "-0.1"
                                         : "nan")),
              std::string::npos);
  }
  std::filesystem::remove(velodyne_file(folder.path(), 7));
  EXPECT_NE(message(world.scene, lidar).find("expected 20 or more frames, got 19"),
            std::string::npos);
}

}  // namespace
}  // namespace infrasim
