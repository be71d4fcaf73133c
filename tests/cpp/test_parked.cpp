#include <gtest/gtest.h>

#include <algorithm>

#include <cmath>

#include "infrasim/pipeline/world.h"
#include "infrasim/scene/overlaps.h"
#include "infrasim/scene/parked.h"
#include "infrasim/scene/site_rules.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::configs;
using testing::error_of;
using testing::expect_within;
using testing::simulate_traffic;
using testing::TestFolder;

/// Returns the scene `curve` with a duration of five seconds and rows of parked vehicles.
SceneConfig with_parked(const std::string& rows) {
  const std::vector<std::string> assignments{"duration_s=5", "traffic.warm_up_s=5",
                                             "parked=" + rows};
  return read_scene(configs() / "scenes/curve.yaml", assignments);
}

/// Rows along both kerbs and in a car park.
constexpr char kKerbs[] =
    "[{road: bend, offset_m: -8.6, to_m: 280, class_shares: {Car: 0.8, Van: 0.2}}, "
    "{road: bend, offset_m: 8.6, class_shares: {Car: 1}, occupied: 0.5}, "
    "{road: bend, offset_m: 24, from_m: 10, to_m: 80, turn_deg: 90, gap_m: 0.4, "
    "class_shares: {Car: 1}}]";

TEST(parked, vehicles_stand_apart_and_beside_the_traffic) {
  const SceneConfig scene = with_parked(kKerbs);
  EXPECT_GT(build_site(scene).parked.size(), 80U);
  EXPECT_TRUE(traffic_overlaps(scene).empty());
}

TEST(parked, vehicles_stand_for_the_whole_run_and_change_nothing_of_the_traffic) {
  const SceneConfig scene = with_parked(kKerbs);
  const std::vector<ParkedVehicle> parked = build_site(scene).parked;
  const Trajectories traffic = simulate_traffic(build_site(scene));
  const World world = build_world(scene);
  ASSERT_EQ(world.trajectories->rows.size(), traffic.rows.size());
  const std::vector<ObjectState>& standing = world.trajectories->standing;
  ASSERT_EQ(standing.size(), parked.size());
  EXPECT_EQ(standing.back().id, kFirstParkedId + static_cast<int>(parked.size()) - 1);
  EXPECT_EQ(standing.back().box.x, parked.back().state.box.x);
  EXPECT_EQ(standing.back().speed_m_s, 0);
  for (std::size_t k = 0; k < traffic.rows.size(); ++k)
    EXPECT_EQ(world.trajectories->rows[k], traffic.rows[k]);
  const auto objects = world.objects_in_frame(0, kUsualPeriod_s);
  EXPECT_EQ(objects.size(), world.trajectories->rows[0].size() + parked.size());
  EXPECT_TRUE(std::ranges::is_sorted(objects, {}, &MovingObject::id));
}

TEST(parked, vehicles_are_a_draw_of_the_seed) {
  SceneConfig scene = with_parked(kKerbs);
  const double x = build_site(scene).parked.front().state.box.x;
  EXPECT_EQ(build_site(scene).parked.front().state.box.x, x);
  scene.seed = 2;
  EXPECT_NE(build_site(scene).parked.front().state.box.x, x);
}

TEST(parked, vehicles_at_a_kerb_face_as_the_traffic_beside_them) {
  const SceneConfig scene = with_parked(kKerbs);
  for (const auto& [vehicle, place] : build_site(scene).parked) {
    if (vehicle.box.x > -50) continue;  // in the bend
    const double ahead = std::cos(vehicle.box.heading);
    const double y = vehicle.box.y;
    const double wanted = y > 12 ? 0 : (y < 0 ? 1 : -1);
    EXPECT_NEAR(ahead, wanted, y > 12 ? 0.04 : 0.001);
  }
}

TEST(parked, no_place_is_taken_of_a_row_that_is_not_occupied) {
  EXPECT_TRUE(build_site(with_parked("[{road: bend, offset_m: -8.6, occupied: 0, "
                                     "class_shares: {Car: 1}}]"))
                  .parked.empty());
}

TEST(parked, rows_in_one_place_are_refused) {
  const std::string message = error_of([] {
    build_world(
        with_parked("[{road: bend, offset_m: -9, class_shares: {Car: 1}}, "
                    "{road: bend, offset_m: -9.5, class_shares: {Car: 1}}]"));
  });
  EXPECT_NE(message.find("got a Car "), std::string::npos) << message;
  EXPECT_NE(message.find(" m wide with seed 1 that overlaps another object"), std::string::npos)
      << message;
}

TEST(parked, vehicles_on_a_lane_are_told_an_offset_beside_the_lanes) {
  const auto message_of = [](double offset_m, const std::string& rest) {
    return error_of([&] {
      checked_site(
          with_parked("[{road: bend, offset_m: " + std::to_string(offset_m) + rest + "}]"));
    });
  };
  for (const std::string rest :
       {", class_shares: {Bus: 1}", ", to_m: 200, class_shares: {Car: 0.5, Truck: 0.5}",
        ", turn_deg: 90, gap_m: 1, class_shares: {Van: 1}"})
    for (const double side : {-1, 1}) {
      const std::string message = message_of(5.2 * side, rest);
      expect_within(message, "m or more from the centreline for a ");
      expect_within(message, " m wide with seed 1, got ");
      const double offset_m =
          std::stod(message.substr(message.find("expected ") + std::string("expected ").size()));
      EXPECT_NO_THROW(checked_site(
          with_parked("[{road: bend, offset_m: " + std::to_string(offset_m * side) + rest + "}]")))
          << message;
      expect_within(message_of((offset_m - 0.03) * side, rest), "m or more from the centreline");
    }
}

TEST(parked, a_vehicle_on_the_lane_of_another_road_is_named_with_its_size_and_seed) {
  const std::vector<std::string> rows{
      "parked=[{road: main, offset_m: -16, class_shares: {Bus: 1}}]"};
  const std::string message =
      error_of([&] { checked_site(read_scene(configs() / "scenes/crossroad.yaml", rows)); });
  expect_within(message, "expected a position beside the lanes or 4.5 m above them, got a Bus 1");
  expect_within(message, " m wide with seed 1 on a lane near x ");
}

TEST(parked, more_vehicles_than_are_looked_at_are_refused) {
  const std::string message = error_of([] {
    SceneConfig scene = with_parked("[{road: bend, offset_m: -9, class_shares: {Motorcycle: 1}}]");
    scene.roads[0].centreline[0].line_m = 9000;
    build_site(scene);
  });
  EXPECT_NE(message.find("expected at most 2000"), std::string::npos) << message;
}

TEST(parked, vehicles_stand_beside_recorded_ones_with_other_ids) {
  const auto recorded = [](int id) {
    const TestFolder folder;
    std::string rows = "t,id,class,x,y,z,heading,dx,dy,dz,speed\n";
    for (const char* t : {"0", "0.1", "0.2"})
      rows += std::string(t) + "," + std::to_string(id) + ",Car,0,-5.25,0.8,0,4.5,2,1.6,0\n";
    folder.write("recorded.csv", rows);
    SceneConfig scene = with_parked("[{road: bend, offset_m: -8.6, class_shares: {Car: 1}}]");
    scene.folder = folder.path();
    scene.traffic.reset();
    scene.trajectories = "recorded.csv";
    scene.duration_s = 0.2;
    return build_world(scene).objects_in_frame(1, kUsualPeriod_s).size();
  };
  EXPECT_GT(recorded(7), 20U);
  const std::string message = error_of([&] { recorded(kFirstParkedId); });
  EXPECT_NE(message.find("id: expected ids below 1000000000, where the ids of parked"),
            std::string::npos)
      << message;
}

}  // namespace
}  // namespace infrasim
