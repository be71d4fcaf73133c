#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "infrasim/core/files.h"
#include "infrasim/pipeline/trajectory_file.h"
#include "infrasim/scene/trajectory_text.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::car_on_road;
using testing::empty_road;
using testing::error_of;
using testing::TestFolder;

constexpr int kSteps = 10;

/// Returns a world with a car that drives from row 2 on and leaves after row 8, a car that waits in
/// rows 3 to 7, and a parked car.
World world_of_three(double wait_x = 20) {
  World world = build_world(empty_road());
  Trajectories all;
  for (int k = 0; k <= kSteps; ++k) {
    auto& row = all.rows.emplace_back();
    if (k >= 2 && k <= 8) row.push_back(car_on_road(1, 3 * k, -1.8, 0, 30));
    const int moved = k < 3 ? k - 3 : (k > 7 ? k - 7 : 0);
    if (k > 0) row.push_back(car_on_road(2, wait_x + moved, 1.8, 0, moved == 0 ? 0 : 10));
  }
  all.standing.push_back(car_on_road(9, 50, 8, 0));
  world.trajectories = std::make_shared<const Trajectories>(std::move(all));
  return world;
}

std::vector<bool> rows(const std::vector<std::pair<int, int>>& ranges) {
  std::vector<bool> out(kSteps + 1);
  for (const auto& [first, last] : ranges)
    for (int k = first; k <= last; ++k) out[static_cast<std::size_t>(k)] = true;
  return out;
}

/// Returns the text of trajectories.csv after several runs.
std::string merged(const World& world, const std::vector<std::vector<bool>>& runs) {
  const TestFolder folder;
  const auto file = folder.path() / "trajectories.csv";
  for (const auto& run : runs) merge_trajectories(file, world, run);
  return read_file(file);
}

TEST(merged_trajectories, of_all_rows_are_the_text_of_the_trajectories) {
  const World world = world_of_three();
  const std::string text = merged(world, {rows({{0, kSteps}})});
  EXPECT_EQ(text, trajectories_csv(*world.trajectories));
  const TestFolder folder;
  const Trajectories back = read_trajectories(folder.write("t.csv", text));
  ASSERT_EQ(back.steps(), kSteps);
  for (int k = 0; k <= kSteps; ++k)
    EXPECT_EQ(back.moving_at(k),
              with_standing(world.trajectories->moving_at(k), world.trajectories->standing))
        << k;
}

TEST(merged_trajectories, have_a_standing_car_only_in_the_first_and_the_last_row) {
  const std::string text = merged(world_of_three(), {rows({{0, kSteps}})});
  std::string of_parked;
  for (std::size_t at = 0; (at = text.find(",9,Car", at)) != std::string::npos; ++at) {
    const std::size_t line = text.rfind('\n', at) + 1;
    of_parked += text.substr(line, at - line) + " ";
  }
  EXPECT_EQ(of_parked, "0 1 ");
}

TEST(merged_trajectories, have_only_the_rows_that_the_frames_need) {
  const std::string text = merged(world_of_three(), {rows({{4, 5}})});
  EXPECT_EQ(text.find("\n0.3,"), std::string::npos);
  EXPECT_NE(text.find("\n0.4,1,"), std::string::npos);
  EXPECT_NE(text.find("\n0.5,9,"), std::string::npos);
  EXPECT_EQ(text.find("\n0.6,"), std::string::npos);
}

TEST(merged_trajectories, do_not_depend_on_the_order_of_the_runs) {
  const World world = world_of_three();
  const std::vector<std::pair<int, int>> parts{{0, 1}, {1, 4}, {6, 7}, {9, 10}};
  const std::string once = merged(world, {rows(parts)});
  EXPECT_EQ(merged(world, {rows({parts[3]}), rows({parts[1]}), rows({parts[0], parts[2]})}), once);
  EXPECT_EQ(merged(world, {rows(parts), rows({parts[2]}), rows(parts)}), once);
  const std::string all = merged(world, {rows({{0, kSteps}})});
  EXPECT_EQ(merged(world, {rows(parts), rows({{0, 10}})}), all);
  EXPECT_EQ(merged(world, {rows({{0, 10}}), rows(parts)}), all);
  for (int k = 0; k < kSteps; ++k)
    EXPECT_EQ(merged(world, {rows({{k, kSteps}}), rows({{0, k}})}), all) << k;
}

TEST(merged_trajectories, of_a_run_with_other_objects_are_refused) {
  const World world = world_of_three(), other = world_of_three(21);
  const TestFolder folder;
  const auto file = folder.path() / "trajectories.csv";
  merge_trajectories(file, world, rows({{0, 6}}));
  const std::string before = read_file(file);
  const std::string message =
      error_of<IoError>([&] { merge_trajectories(file, other, rows({{3, 9}})); });
  EXPECT_NE(message.find("at 0.3 s it has object 2 at x 20, y 1.8, this run has it at x 21"),
            std::string::npos)
      << message;
  World empty = world_of_three();
  empty.trajectories = std::make_shared<const Trajectories>(
      Trajectories{std::vector<std::vector<ObjectState>>(kSteps + 1), false, {}});
  EXPECT_NE(error_of<IoError>([&] {
              merge_trajectories(file, empty, rows({{3, 9}}));
            }).find("this run has no such object"),
            std::string::npos);
  EXPECT_EQ(read_file(file), before);
}

/// Returns the world with moving objects that `change` has changed.
World with_moving(World world, const std::function<void(Trajectories&)>& change) {
  Trajectories all = *world.trajectories;
  change(all);
  world.trajectories = std::make_shared<const Trajectories>(std::move(all));
  return world;
}

/// Returns the world as a world with recorded trajectories, whose folder must have all rows.
World recorded(World world) {
  world.scene.traffic.reset();
  return world;
}

void add_car(Trajectories& all) { all.rows[4].push_back(car_on_road(3, 80, 1.8, 0)); }

/// Moves the waiting car in a row in which the file omits its state, because the states before and
/// after are equal.
void move_waiting_car(Trajectories& all) { all.rows[5].back().box.y += 0.5; }

void remove_car(Trajectories& all) {
  for (auto& row : all.rows) std::erase_if(row, [](const ObjectState& s) { return s.id == 1; });
}

void add_standing(Trajectories& all) { all.standing.push_back(car_on_road(10, 60, 8, 0)); }

TEST(merged_trajectories, of_an_edited_recording_are_refused) {
  const World world = recorded(world_of_three());
  const std::vector<bool> whole = rows({{0, kSteps}});
  for (const auto& [change, what] :
       std::vector<std::pair<std::function<void(Trajectories&)>, std::string>>{
           {add_car, "at 0.4 s it has no object 3 at x 80, y 1.8, where this run has one"},
           {move_waiting_car, "at 0.5 s it has no object 2 at x 20, y 2.3"},
           {remove_car, "at 0.2 s it has object 1 at x 6, y -1.8, this run has no such object"},
           {add_standing, "at 0 s it has no object 10 at x 60, y 8"}}) {
    const World other = with_moving(recorded(world_of_three()), change);
    for (const auto& [first, second] : {std::pair(&world, &other), std::pair(&other, &world)}) {
      const TestFolder folder;
      const auto file = folder.path() / "trajectories.csv";
      merge_trajectories(file, *first, whole);
      const std::string before = read_file(file);
      const std::string message =
          error_of<IoError>([&] { merge_trajectories(file, *second, whole); });
      if (first == &world) testing::expect_within(message, what);
      EXPECT_EQ(read_file(file), before);
    }
  }
}

TEST(merged_trajectories, without_an_object_of_a_row_of_both_runs_are_refused) {
  const TestFolder folder;
  const auto file = folder.path() / "trajectories.csv";
  merge_trajectories(file, world_of_three(), rows({{0, 4}}));
  const World other = with_moving(world_of_three(), add_car);
  testing::expect_within(
      error_of<IoError>([&] { merge_trajectories(file, other, rows({{4, 9}})); }),
      "at 0.4 s it has no object 3 at x 80, y 1.8");
}

TEST(merged_trajectories, of_an_earlier_version_with_every_state_belong_to_the_run) {
  const World world = recorded(world_of_three());
  const TestFolder folder;
  std::string every;
  for (int k = 0; k <= kSteps; ++k) {  // a file of a single row omits no state
    const std::string text = merged(world_of_three(), {rows({{k, k}})});
    every += k == 0 ? text : text.substr(text.find('\n') + 1);
  }
  const auto file = folder.write("trajectories.csv", every);
  EXPECT_NO_THROW(merge_trajectories(file, world, rows({{0, kSteps}})));
  EXPECT_EQ(read_file(file), merged(world, {rows({{0, kSteps}})}));
}

TEST(merged_trajectories, are_in_the_time_of_the_mounts_clock) {
  World world = world_of_three();
  world.late_s = 0.05;
  const std::string text = merged(world, {rows({{4, 5}})});
  EXPECT_NE(text.find("\n0.4,1,Car,13.5,"), std::string::npos) << text;
}

TEST(rows_of_frames, are_those_around_their_begins_and_ends) {
  const std::vector<int> frames{3, 4};
  EXPECT_EQ(rows_of_frames(frames, 0.1, kSteps), rows({{3, 5}}));
  EXPECT_EQ(rows_of_frames(frames, 0.05, kSteps), rows({{1, 3}}));
  EXPECT_EQ(rows_of_frames(frames, 0.2, kSteps), rows({{6, 10}}));
  EXPECT_EQ(rows_of_frames(frames, 1 / 15.0, kSteps), rows({{2, 4}}));
  std::vector<bool> asked(kSteps + 1);
  mark_true_rows(rows({{3, 5}}), -0.03, asked);
  EXPECT_EQ(asked, rows({{2, 5}}));
}

}  // namespace
}  // namespace infrasim
