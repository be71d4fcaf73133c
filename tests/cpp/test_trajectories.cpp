#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <limits>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "infrasim/pipeline/simulate.h"
#include "infrasim/scene/lazy_trajectories.h"
#include "infrasim/scene/site_rules.h"
#include "infrasim/scene/state_source.h"
#include "infrasim/scene/trajectories.h"
#include "infrasim/scene/trajectory_text.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::car_on_road;
using testing::empty_road;
using testing::error_of;
using testing::expect_message;
using testing::simulate_traffic;
using testing::TestFolder;

const std::string kHeader = "t,id,class,x,y,z,heading,dx,dy,dz,speed\n";

Trajectories read(const std::string& text) {
  const TestFolder folder;
  return read_trajectories(folder.write("file.csv", text));
}

void expect_error(const std::string& rows, int line, const std::string& key,
                  const std::string& what) {
  SCOPED_TRACE(rows);
  const TestFolder folder;
  const auto file = folder.write("file.csv", kHeader + rows);
  expect_message(error_of([&] { read_trajectories(file); }), file, line, key, what);
}

/// Returns the row of a car with usual values, and with the given time, id and x.
std::string row(const std::string& t, int id, const std::string& x) {
  return t + "," + std::to_string(id) + ",Car," + x + ",2,0.75,0.1,4.5,1.9,1.5,10\n";
}

SceneConfig road_with_traffic(double vehicles_per_km_lane) {
  SceneConfig scene = empty_road();
  scene.duration_s = 3;
  scene.traffic->vehicles_per_km_lane = vehicles_per_km_lane;
  scene.traffic->warm_up_s = 5;
  return scene;
}

// --- the file ---------------------------------------------------------------------------------

TEST(trajectories, written_and_read_are_the_same) {
  const Trajectories written = simulate_traffic(build_site(road_with_traffic(15)));
  const std::string text = trajectories_csv(written);
  const Trajectories back = read(text);
  ASSERT_EQ(back.rows.size(), written.rows.size());
  for (std::size_t k = 0; k < back.rows.size(); ++k) {
    ASSERT_EQ(back.rows[k].size(), written.rows[k].size());
    for (std::size_t i = 0; i < back.rows[k].size(); ++i) {
      const ObjectState &a = written.rows[k][i], &b = back.rows[k][i];
      EXPECT_EQ(a.id, b.id);
      EXPECT_EQ(a.object_class, b.object_class);
      EXPECT_EQ(a.box.x, b.box.x);
      EXPECT_EQ(a.box.heading, b.box.heading);
      EXPECT_EQ(a.box.dz, b.box.dz);
      EXPECT_EQ(a.speed_m_s, b.speed_m_s);
    }
  }
  EXPECT_EQ(trajectories_csv(back), text);
}

TEST(trajectories, with_any_instants_without_vehicles_written_and_read_are_the_same) {
  for (const bool pitched : {false, true})
    for (unsigned somebody = 1; somebody < 32; ++somebody) {
      Trajectories sparse{std::vector<std::vector<ObjectState>>(5), pitched, {}};
      for (std::size_t k = 0; k < 5; ++k)
        if ((somebody >> k & 1) != 0) sparse.rows[k] = {car_on_road(static_cast<int>(k), 0, 0, 0)};
      const std::string text = trajectories_csv(sparse);
      const Trajectories back = read(text);
      ASSERT_EQ(back.rows.size(), 5U) << text;
      for (std::size_t k = 0; k < 5; ++k) EXPECT_EQ(back.rows[k].size(), sparse.rows[k].size());
      EXPECT_EQ(trajectories_csv(back), text);
    }
}

TEST(trajectories, of_a_scene_without_anybody_are_a_header_that_fits_any_duration) {
  SceneConfig scene = road_with_traffic(0);
  const TestFolder folder;
  const std::string text = trajectories_csv(*build_world(scene).trajectories);
  EXPECT_EQ(text, kHeader);
  scene.trajectories = folder.write("file.csv", text).string();
  scene.traffic.reset();
  EXPECT_EQ(build_world(scene).trajectories->steps(), 30);
}

/// Returns the scene with a height profile. The road rises, so the tables have a column for the
/// pitch.
SceneConfig with_profile(SceneConfig scene) {
  scene.profile.emplace();
  scene.profile->points_m = {{-150, -9}, {0, 0}, {150, -6}};
  scene.profile->vertical_curve_m = 120;
  scene.mounts["pole"].z_m = 6;
  return scene;
}

SceneConfig people_alone(std::uint64_t seed) {
  SceneConfig scene = road_with_traffic(0);
  scene.seed = seed;
  scene.duration_s = 60;
  PeopleConfig people;
  people.road = "road";
  people.offset_m = 8;
  people.from_m = 180;
  people.to_m = 190;
  people.per_km = 30;
  scene.people.emplace().push_back(people);
  return scene;
}

TEST(trajectories, of_any_scene_give_the_same_vehicles_and_people_from_their_file) {
  int begin_or_end_empty = 0;
  std::vector<SceneConfig> scenes{road_with_traffic(15), with_profile(road_with_traffic(15))};
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    scenes.push_back(people_alone(seed));
    scenes.push_back(with_profile(people_alone(seed)));
  }
  for (SceneConfig& scene : scenes) {
    const Trajectories driven = *build_world(scene).trajectories;
    begin_or_end_empty += driven.rows.front().empty() || driven.rows.back().empty();
    const std::string text = trajectories_csv(driven);
    const TestFolder folder;
    scene.trajectories = folder.write("file.csv", text).string();
    scene.traffic.reset();
    scene.people.reset();
    scene.profile.reset();  // the heights in a file already include the profile
    EXPECT_EQ(trajectories_csv(*build_world(scene).trajectories), text) << scene.seed;
  }
  EXPECT_GE(begin_or_end_empty, 4);
}

TEST(trajectories, give_the_same_frames_from_their_file_as_from_the_traffic) {
  SceneConfig scene = road_with_traffic(15);
  const World driven = build_world(scene);
  const TestFolder folder;
  scene.trajectories = folder.write("file.csv", trajectories_csv(*driven.trajectories)).string();
  scene.traffic.reset();
  const World recorded = build_world(scene);
  const std::array lidars{testing::plain_lidar("lidar", testing::spinning(16, -20, 0, 1))};
  FrameSimulator a(driven, lidars), b(recorded, lidars);
  for (const int k : {0, 29}) {
    const Frame one = a.simulate(k, {true}).front(), other = b.simulate(k, {true}).front();
    testing::expect_equal(one.cloud, other.cloud);
    ASSERT_EQ(one.objects.size(), other.objects.size());
    EXPECT_GT(one.objects.size(), 0U);
    for (std::size_t i = 0; i < one.objects.size(); ++i) {
      EXPECT_EQ(one.objects[i].points, other.objects[i].points);
      EXPECT_EQ(one.objects[i].box.heading, other.objects[i].box.heading);
    }
  }
}

TEST(trajectories, handed_over_one_by_one_are_those_of_the_world) {
  const SceneConfig scene = road_with_traffic(15);
  const Site site = checked_site(scene);
  const StateSource source(site);
  std::string text;
  int rows = 0;
  write_trajectories(
      false,
      [&](const RowSink& sink) {
        rows = 0;
        source.each([&](const auto& states) { sink(rows++, states); });
      },
      [&](std::string_view piece) { text += piece; });
  EXPECT_EQ(text, trajectories_csv(*build_world(scene).trajectories));
  EXPECT_EQ(rows, 31);
}

TEST(trajectories, handed_over_one_by_one_need_a_scene_that_is_right_as_a_whole) {
  SceneConfig scene = road_with_traffic(15);
  scene.gantries.push_back({.road = "other", .s_m = 1, .place = {}});
  EXPECT_NE(
      error_of([&] { StateSource(checked_site(scene)).each([](const auto&) {}); }).find("'other'"),
      std::string::npos);
}

TEST(trajectories, shorter_than_the_scene_are_an_error) {
  const TestFolder folder;
  SceneConfig scene = empty_road();
  scene.traffic.reset();
  scene.trajectories = folder.write("file.csv", kHeader + row("0", 1, "0") + row("0.1", 1, "1"));
  EXPECT_NE(error_of([&] { build_world(scene); }).find("duration_s"), std::string::npos);
}

TEST(trajectories, in_a_scene_file_are_relative_to_it) {
  const TestFolder folder;
  SceneConfig scene = empty_road();
  scene.duration_s = 0.1;
  scene.traffic.reset();
  scene.trajectories = "file.csv";
  folder.write("file.csv", kHeader + row("0", 1, "0") + row("0.1", 1, "1"));
  const auto file = folder.write("scene.yaml", dump_scene(scene));
  EXPECT_EQ(build_world(read_scene(file)).trajectories->steps(), 1);
}

TEST(trajectory_file, rows_out_of_order_are_an_error) {
  expect_error(row("0", 1, "0") + row("0.1", 1, "1") + row("0", 2, "5"), 4, "t", "before");
  expect_error(row("0", 2, "0") + row("0", 1, "9") + row("0.1", 1, "9"), 3, "id", "ascending ids");
  expect_error(row("0", 2, "0") + row("0", 2, "0"), 3, "id", "ascending ids");
}

TEST(trajectory_file, a_vehicle_that_comes_back_after_a_gap_is_an_error) {
  const std::string other = row("0.1", 2, "50");
  expect_error(row("0", 1, "0") + row("0", 2, "50") + other + row("0.2", 1, "2"), 5, "id", "gap");
}

TEST(trajectory_file, of_equal_states_in_a_row_has_the_first_and_the_last) {
  const std::string standing = row("0.1", 1, "1"), text = row("0", 1, "0") + standing;
  const Trajectories back =
      read(kHeader + text + row("0.3", 2, "50") + row("0.5", 1, "1") + row("0.6", 1, "2"));
  ASSERT_EQ(back.rows.size(), 7U);
  for (std::size_t k = 1; k <= 5; ++k) {
    ASSERT_EQ(back.rows[k].size(), k == 3 ? 2U : 1U) << k;
    EXPECT_EQ(back.rows[k].front(), back.rows[1].front()) << k;
  }
  EXPECT_EQ(trajectories_csv(back),
            kHeader + text + row("0.3", 2, "50") + row("0.5", 1, "1") + row("0.6", 1, "2"));
}

TEST(trajectory_file, a_jump_or_a_sudden_turn_is_an_error) {
  expect_error(row("0", 1, "0") + row("0.1", 1, "10.1"), 3, "x", "10 m");
  expect_error(row("0", 1, "0") + "0.1,1,Car,0,2,0.75,1.2,4.5,1.9,1.5,10\n", 3, "heading", "60");
  EXPECT_NO_THROW(read(row("0", 1, "0").insert(0, kHeader) + row("0.1", 1, "9.9")));
}

TEST(trajectory_file, a_heading_may_pass_from_pi_to_minus_pi) {
  EXPECT_NO_THROW(read(kHeader + "0,1,Car,0,2,0.75,3.1,4.5,1.9,1.5,10\n" +
                       "0.1,1,Car,0,2,0.75,-3.1,4.5,1.9,1.5,10\n"));
}

TEST(trajectory_file, a_vehicle_that_changes_its_size_or_class_is_an_error) {
  expect_error(row("0", 1, "0") + "0.1,1,Car,0,2,0.75,0.1,4.6,1.9,1.5,10\n", 3, "dx", "size");
  expect_error(row("0", 1, "0") + "0.1,1,Van,0,2,0.75,0.1,4.5,1.9,1.5,10\n", 3, "dx", "class");
}

TEST(trajectory_file, an_unknown_class_is_an_error_that_names_the_known_ones) {
  expect_error("0,1,Tram,0,2,0.75,0.1,4.5,1.9,1.5,10\n", 2, "class", "got 'Tram'");
}

TEST(trajectory_file, too_few_or_too_many_columns_are_an_error) {
  expect_error("0,1,Car,0,2,0.75,0.1,4.5,1.9,1.5\n", 2, "(row)", "expected 11 columns");
  expect_error("0,1,Car,0,2,0.75,0.1,4.5,1.9,1.5,10,7\n", 2, "(row)", "expected 11 columns");
  expect_error("\n", 2, "(row)", "expected 11 columns, got ''");
}

TEST(trajectory_file, an_error_of_a_cell_names_its_column) {
  const TestFolder folder;
  const auto file = folder.write("file.csv", kHeader + row("0", 1, "east"));
  EXPECT_TRUE(error_of([&] { read_trajectories(file); }).starts_with(file.string() + ":2:9: x: "));
}

TEST(trajectory_file, what_is_no_number_is_an_error) {
  for (const char* x : {"nan", "inf", "1e99", "", "1x", " 1"})
    expect_error(row("0", 1, x), 2, "x", "got '" + std::string(x) + "'");
  expect_error("0,1.5,Car,0,2,0.75,0.1,4.5,1.9,1.5,10\n", 2, "id", "'1.5'");
  expect_error("0,-1,Car,0,2,0.75,0.1,4.5,1.9,1.5,10\n", 2, "id", "'-1'");
  expect_error("0,1,Car,0,2,0.75,0.1,0,1.9,1.5,10\n", 2, "dx", "'0'");
}

TEST(trajectory_file, starts_at_0_and_steps_by_a_tenth_of_a_second) {
  expect_error(row("0.1", 1, "0") + row("0.2", 1, "0"), 2, "t", "got a later time");
  expect_error(row("0", 1, "0") + row("0.2", 1, "1"), 3, "id", "0.1 s");
  expect_error(row("0", 1, "0") + row("0.05", 1, "0"), 3, "t", "0.1 s");
  expect_error(row("0", 1, "0"), 2, "t", "two");
}

TEST(trajectory_file, a_row_of_its_time_alone_says_that_nobody_is_there) {
  const std::string nobody = ",,,,,,,,,,\n";
  EXPECT_EQ(read(kHeader + "0" + nobody + row("0.3", 1, "0") + "0.5" + nobody).rows.size(), 6U);
  expect_error("0,,Car,,,,,,,,\n", 2, "id", "expected a number, got an empty cell");
  expect_error("0.5" + nobody + row("0.6", 1, "0"), 2, "t", "got a later time");
}

TEST(trajectory_file, needs_its_header) {
  const TestFolder folder;
  for (const char* text : {"", "t,id\n", "t,id,class,x,y,z,heading,dx,dy,dz\n"}) {
    const auto file = folder.write("file.csv", text);
    expect_message(error_of([&] { read_trajectories(file); }), file, 1, "(header)", "t,id,class");
  }
  error_of<IoError>([&] { read_trajectories(folder.path() / "none.csv"); });
}

// --- between rows -----------------------------------------------------------------------------

MovingObject moving(double from_heading, double to_heading) {
  MovingObject object;
  object.from = {0, 10, 1, 4.5, 1.9, 1.5, from_heading};
  object.to = {2, 11, 0, 4.5, 1.9, 1.5, to_heading};
  return object;
}

TEST(standing_objects, with_any_id_are_among_the_moving_ones) {
  const int last = std::numeric_limits<int>::max();
  const std::vector<ObjectState> standing{car_on_road(0, 10, 8, 0), car_on_road(last, 20, 8, 0)};
  const auto ids = [&](const std::vector<MovingObject>& moving) {
    std::vector<int> out;
    for (const MovingObject& o : with_standing(moving, standing)) out.push_back(o.id);
    return out;
  };
  MovingObject moving;
  moving.id = 5;
  EXPECT_EQ(ids({}), (std::vector<int>{0, last}));
  EXPECT_EQ(ids({moving}), (std::vector<int>{0, 5, last}));
}

TEST(moving_object, position_is_linear_in_time) {
  const Box3d box = moving(0, 0).at(0.25);
  EXPECT_DOUBLE_EQ(box.x, 0.5);
  EXPECT_DOUBLE_EQ(box.y, 10.25);
  EXPECT_DOUBLE_EQ(box.z, 0.75);
  EXPECT_EQ(box.dx, 4.5);
}

TEST(moving_object, heading_goes_the_short_way) {
  EXPECT_NEAR(moving(0.1, 0.3).at(0.5).heading, 0.2, 1e-12);
  EXPECT_NEAR(moving(kPi - 0.1, -kPi + 0.3).at(0.5).heading, -kPi + 0.1, 1e-12);
  EXPECT_NEAR(moving(-kPi + 0.1, kPi - 0.3).at(0.5).heading, kPi - 0.1, 1e-12);
}

TEST(trajectories, in_a_frame_are_the_vehicles_that_are_there_at_both_of_its_ends) {
  Trajectories t;
  t.rows = {{car_on_road(1, 0, 0, 0, 8), car_on_road(2, 9, 0, 0), car_on_road(4, 30, 0, 0)},
            {car_on_road(1, 1, 0, 0, 12), car_on_road(3, 20, 0, 0), car_on_road(4, 31, 0, 0)}};
  const auto objects = t.between(0, 1);
  ASSERT_EQ(objects.size(), 2U);
  EXPECT_EQ(objects[0].id, 1);
  EXPECT_EQ(objects[0].to.x, 1);
  EXPECT_EQ(objects[0].speed_m_s, 10);
  EXPECT_EQ(objects[1].id, 4);
}

// --- trajectories of some frames ----------------------------------------------------------------

/// Returns the trajectories of three cars for ten frames.
Trajectories three_cars() {
  return testing::straight_on(
      {car_on_road(1, 0, 0, 0, 8), car_on_road(2, 9, 0, 0), car_on_road(4, 30, 0, 0, 5)}, 10);
}

Trajectories kept(const Trajectories& from, std::vector<bool> asked, std::size_t most,
                  std::size_t instants = 11) {
  TrajectoryKeeper keeper(std::move(asked), false, most);
  for (std::size_t k = 0; k < instants; ++k) keeper.take(from.rows[k]);
  return keeper.finish();
}

bool equal(const std::vector<MovingObject>& a, const std::vector<MovingObject>& b) {
  return std::ranges::equal(a, b, [](const MovingObject& m, const MovingObject& n) {
    return m.id == n.id && m.from.x == n.from.x && m.from.pitch == n.from.pitch &&
           m.to.x == n.to.x && m.speed_m_s == n.speed_m_s;
  });
}

bool same_in_frame(const Trajectories& a, const Trajectories& b, int k) {
  return equal(a.between(k, k + 1), b.between(k, k + 1));
}

TEST(kept_trajectories, are_whole_while_they_are_few) {
  std::vector<bool> asked(11);
  asked[3] = asked[4] = true;
  EXPECT_EQ(trajectories_csv(kept(three_cars(), asked, 33)), trajectories_csv(three_cars()));
  EXPECT_TRUE(kept(three_cars(), asked, 33).kept.empty());
  EXPECT_TRUE(kept(three_cars(), std::vector<bool>(11, true), 0).kept.empty());
}

TEST(kept_trajectories, that_are_many_are_those_of_the_frames_asked_for) {
  const Trajectories all = three_cars();
  for (const std::size_t most : {0U, 11U, 32U}) {
    std::vector<bool> asked(11);
    asked[3] = asked[4] = asked[9] = asked[10] = true;
    const Trajectories some = kept(all, asked, most);
    EXPECT_EQ(some.steps(), 10);
    EXPECT_FALSE(some.kept.empty());
    for (const int k : {3, 9}) EXPECT_TRUE(same_in_frame(some, all, k));
    for (const int k : {0, 2, 4, 8}) EXPECT_THROW(some.between(k, k + 1), std::logic_error) << k;
    for (const std::size_t k : {0U, 5U, 8U}) EXPECT_EQ(some.rows[k].capacity(), 0U) << k;
  }
}

TEST(kept_trajectories, end_where_nobody_asks_for_more) {
  const Trajectories some = kept(three_cars(), std::vector<bool>(11), 33, 5);
  EXPECT_EQ(some.steps(), 10);
  EXPECT_TRUE(same_in_frame(some, three_cars(), 3));
  EXPECT_THROW(some.between(4, 5), std::logic_error);
}

TEST(kept_trajectories, of_some_frames_give_the_frames_of_all) {
  SceneConfig scene = with_profile(road_with_traffic(15));
  scene.mounts["late"] = scene.mounts["pole"];
  scene.mounts["late"].clock_offset_s = 0.03;
  scene.mounts["early"] = scene.mounts["pole"];
  scene.mounts["early"].clock_offset_s = -0.03;
  const std::vector<std::string> mounts = mount_names(scene);
  const std::vector<World> all = build_worlds(scene, mounts);
  const std::vector<int> frames{0, 7, 29};
  for (std::size_t last = 1; last <= frames.size(); ++last) {
    const std::span<const int> asked = std::span(frames).first(last);
    const std::vector<World> some = build_worlds(scene, mounts, asked, kUsualPeriod_s);
    for (std::size_t m = 0; m < mounts.size(); ++m) {
      for (const int k : asked)
        EXPECT_TRUE(equal(some[m].objects_in_frame(k, kUsualPeriod_s),
                          all[m].objects_in_frame(k, kUsualPeriod_s)));
      EXPECT_EQ(some[m].trajectories->kept.empty(), last == 3);
    }
  }
}

TEST(kept_trajectories, are_shared_by_all_mounts) {
  SceneConfig scene = road_with_traffic(15);
  scene.mounts["other"] = scene.mounts["pole"];
  scene.mounts["other"].clock_offset_s = 0.03;
  const std::vector<World> worlds = build_worlds(scene, mount_names(scene));
  EXPECT_EQ(worlds[0].trajectories, worlds[1].trajectories);
}

// --- as far as requested ------------------------------------------------------------------------

SceneConfig with_clock_offset(SceneConfig scene, double late_s) {
  if (late_s != 0) scene.mounts["pole"].clock_offset_s = late_s;
  return scene;
}

TEST(lazy_trajectories, give_the_frames_of_the_whole_scene_in_any_order) {
  const SceneConfig scene = with_profile(road_with_traffic(15));
  const auto all = build_world(scene).trajectories;
  for (const std::size_t most : {std::size_t{0}, std::size_t{40}, std::size_t{1000}}) {
    LazyTrajectories lazy(std::make_shared<const Site>(build_site(scene)), most);
    ASSERT_EQ(lazy.steps(), all->steps());
    ASSERT_EQ(lazy.pitched(), all->pitched);
    for (const double length : {0.5, 1.0, 2.0})
      for (const double k : {4.0, 4.5, 5.0, 3.3, 28.0, -0.3, 28.3, 17.0})
        EXPECT_TRUE(equal(lazy.between(k, k + length), all->between(k, k + length))) << k;
  }
}

TEST(lazy_trajectories, are_simulated_no_further_than_the_last_frame_requested) {
  for (const double late_s : {0.0, 0.03, -0.03}) {
    SceneConfig scene = with_clock_offset(road_with_traffic(15), late_s);
    scene.duration_s = kLongestScene_s;
    const World world = build_lazy_world(scene);
    LazyTrajectories& lazy = *world.lazy_trajectories;
    EXPECT_EQ(world.trajectories->steps(), lazy.steps());
    EXPECT_EQ(lazy.simulated(), 0);
    frozen_mesh(world, 7, kUsualPeriod_s, 0.5);
    EXPECT_LE(lazy.simulated(), late_s > 0 ? 10 : 9);
    const int before = lazy.simulated();
    frozen_mesh(world, 3, kUsualPeriod_s, 0.5);
    EXPECT_EQ(lazy.simulated(), before);
  }
}

TEST(lazy_trajectories, that_are_many_keep_the_last_rows_until_an_earlier_one_is_requested) {
  SceneConfig scene = road_with_traffic(15);
  scene.duration_s = 60;
  LazyTrajectories lazy(std::make_shared<const Site>(build_site(scene)), 100);
  for (int k = 0; k < 600; ++k) {
    lazy.between(k, k + 1);
    ASSERT_LE(lazy.kept(), 40U);
  }
  EXPECT_LT(lazy.kept(), 40U);
  lazy.between(300, 300 + 1);
  lazy.drive();
  EXPECT_EQ(lazy.kept(), 601U);
  for (const int k : {0, 500}) lazy.between(k, k + 1);
  EXPECT_EQ(lazy.simulated(), 601);
}

TEST(lazy_trajectories, that_are_many_keep_rows_that_were_requested) {
  SceneConfig scene = road_with_traffic(15);
  scene.duration_s = 60;
  const auto all = build_world(scene).trajectories;
  LazyTrajectories lazy(std::make_shared<const Site>(build_site(scene)), 1000);
  const std::array frames{3, 40, 200, 599};
  for (const int k : frames) lazy.between(k, k + 1);
  ASSERT_EQ(lazy.simulated(), 601);
  ASSERT_LT(lazy.kept(), 601U);
  for (const int k : frames)
    EXPECT_TRUE(equal(lazy.between(k, k + 1), all->between(k, k + 1))) << k;
  EXPECT_LT(lazy.kept(), 601U);  // rows are still dropped, so the simulation has not started again
}

TEST(lazy_trajectories, are_the_same_to_several_threads) {
  SceneConfig scene = road_with_traffic(15);
  scene.duration_s = 20;
  const auto all = build_world(scene).trajectories;
  LazyTrajectories lazy(std::make_shared<const Site>(build_site(scene)), 300);
  std::atomic<int> next = 0, same = 0;
  {
    std::vector<std::jthread> threads;
    for (int i = 0; i < 4; ++i)
      threads.emplace_back([&] {
        for (int k = next++; k < 200; k = next++)
          same += equal(lazy.between(k, k + 1), all->between(k, k + 1));
      });
  }
  EXPECT_EQ(same, 200);
}

TEST(lazy_trajectories, refuse_every_frame_from_the_one_in_which_somebody_hits_the_sensor) {
  SceneConfig scene = people_alone(1);
  scene.people->front().per_km = 300;
  scene.mounts["pole"] = {.x_m = -15, .y_m = 8, .z_m = 1};
  const std::string message = error_of([&] { build_world(scene); });
  const World world = build_lazy_world(scene);
  int k = 0;
  EXPECT_EQ(error_of([&] {
              for (; k < 600; ++k) world.objects_in_frame(k, kUsualPeriod_s);
            }),
            message);
  EXPECT_GT(k, 0);
  EXPECT_EQ(error_of([&] { world.objects_in_frame(599, kUsualPeriod_s); }), message);
  EXPECT_EQ(error_of([&] { world.lazy_trajectories->drive(); }), message);
  EXPECT_NO_THROW(world.objects_in_frame(k - 1, kUsualPeriod_s));
}

TEST(static_world, needs_no_trajectories_and_simulates_none) {
  SceneConfig scene = people_alone(1);
  scene.people->front().per_km = 300;
  scene.mounts["pole"] = {.x_m = -15, .y_m = 8, .z_m = 1};
  const World world = build_static_world(scene);  // no vehicle hits the sensor
  EXPECT_EQ(world.lazy_trajectories, nullptr);
  EXPECT_TRUE(world.trajectories->rows.empty());
  scene.traffic.reset();
  scene.trajectories = "none.csv";
  EXPECT_EQ(build_static_world(scene).background().vertices, world.background().vertices);
}

TEST(scenes, of_one_file_move_alike_whatever_their_sensors_see) {
  for (const char* name : {"highway", "crossroad", "crossroad_poles", "curve", "crest"}) {
    const auto read = [&](const std::string& preset, const std::vector<std::string>& set = {}) {
      return read_scene(testing::configs() / "scenes" / (std::string(name) + ".yaml"), set, preset);
    };
    const SceneConfig scene = read("datasheet");
    EXPECT_TRUE(move_alike(scene, read("paper"))) << name;
    EXPECT_TRUE(move_alike(scene, read("paper", {"detail=box", "weather.rain_mm_per_h=9"})));
    for (const char* other :
         {"seed=2", "duration_s=60", "traffic.vehicles_per_km_lane=3", "roads.0.elevation_m=0.01",
          "people=[]", "mounts={p: {x_m: 1, y_m: 1, z_m: 9}}"})
      EXPECT_FALSE(move_alike(scene, read("paper", {other}))) << name << " " << other;
  }
}

// --- another clock ------------------------------------------------------------------------------

TEST(clock_offset, vehicles_are_farther_on_by_the_way_of_the_offset) {
  const Trajectories cars = testing::straight_on({car_on_road(1, 0, 2, 0, 15)}, 4);
  for (const double late_s : {0.05, -0.05, 0.1, -0.1})
    for (int k = 0; k <= 4; ++k) {
      const auto late = cars.moving_at(row_position(k * kRowStep_s + late_s));
      ASSERT_EQ(late.size(), 1U);
      EXPECT_NEAR(late[0].box.x, cars.rows[static_cast<std::size_t>(k)][0].box.x + 15 * late_s,
                  1e-3);
      EXPECT_EQ(late[0].speed_m_s, 15);
    }
}

}  // namespace
}  // namespace infrasim
