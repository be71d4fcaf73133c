#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "infrasim/scene/overlaps.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::car_on_road;
using testing::straight_on;

std::vector<Overlap> overlaps(const Trajectories& trajectories) {
  OverlapSearch search;
  for (const auto& row : trajectories.rows) search.take(row);
  return search.overlaps();
}

/// Returns the number of overlapping pairs of vehicles that stand still.
std::size_t pairs(const std::vector<ObjectState>& standing) {
  return overlaps(straight_on(standing, 0)).size();
}

TEST(overlaps, are_named_with_both_ids_the_time_and_the_place) {
  // The first car is 4.5 m long and moves at 10 m/s towards a standing car 20 m away. They meet
  // after 1.55 s.
  const auto result =
      overlaps(straight_on({car_on_road(7, 20, 3, kPi, 0), car_on_road(4, 0, 3, 0, 10)}, 40));
  ASSERT_EQ(result.size(), 1U);
  EXPECT_EQ(result[0].first_id, 4);
  EXPECT_EQ(result[0].second_id, 7);
  EXPECT_NEAR(result[0].time_s, 1.6, 1e-9);
  EXPECT_NEAR(result[0].place.x, 18, 1e-9);
  EXPECT_NEAR(result[0].place.y, 3, 1e-9);
}

TEST(overlaps, half_way_between_two_instants_are_found) {
  // Two motorcycles cross at 30 m/s. They overlap at 1.05 s, but not at 1.0 s and 1.1 s.
  ObjectState a = car_on_road(1, -31.5, 0, 0, 30), b = car_on_road(2, 0, -31.5, kPi / 2, 30);
  for (ObjectState* s : {&a, &b}) s->box.dx = 1, s->box.dy = 0.5;
  const auto result = overlaps(straight_on({a, b}, 20));
  ASSERT_EQ(result.size(), 1U);
  EXPECT_NEAR(result[0].time_s, 1.05, 1e-9);
}

TEST(overlaps, are_not_those_that_touch) {
  for (const double heading : {0.0, 0.3, kPi / 2, 2.5, -3.0}) {
    const auto behind = [&](double gap) {
      const Vec2 at = (4.5 + gap) * heading_vector(heading);
      return pairs(
          {car_on_road(1, 50, 20, heading), car_on_road(2, 50 + at.x, 20 + at.y, heading)});
    };
    EXPECT_EQ(behind(0), 0U) << heading;
    EXPECT_EQ(behind(-0.01), 1U) << heading;
  }
}

TEST(overlaps, of_turned_boxes_are_those_of_the_boxes_and_not_of_what_is_around_them) {
  // The corner of a box that is turned by 45 degrees points at the side of the other box.
  const double corner = (4.5 / 2 + 1.9 / 2) / std::sqrt(2.0);
  EXPECT_EQ(pairs({car_on_road(1, 0, 0, kPi / 4), car_on_road(2, corner + 2.26, 0, 0)}), 0U);
  EXPECT_EQ(pairs({car_on_road(1, 0, 0, kPi / 4), car_on_road(2, corner + 2.0, 0.9, 0)}), 1U);
  // The boxes are side by side along a diagonal. Their bounding rectangles overlap, but the boxes
  // do not.
  EXPECT_EQ(pairs({car_on_road(1, 0, 0, kPi / 4), car_on_road(2, -1.5, 1.5, kPi / 4)}), 0U);
}

TEST(overlaps, of_a_bridge_and_the_road_below_are_none) {
  ObjectState above = car_on_road(2, 0, 0, kPi / 2);
  above.box.z += 4.5;
  EXPECT_EQ(pairs({car_on_road(1, 0, 0, 0), above}), 0U);
  above.box.z -= 4;
  EXPECT_EQ(pairs({car_on_road(1, 0, 0, 0), above}), 1U);
}

TEST(overlaps, of_a_bridge_on_a_slope_are_none_however_far_along_it_they_are) {
  const auto on_slope = [](int id, double along, double up_m) {
    ObjectState bus = car_on_road(id, along, 0, 0);
    bus.box.dx = 12, bus.box.dz = 3;
    bus.box.z = 1.5 + up_m + 0.06 * along;
    bus.box.pitch = -std::atan(0.06);
    return bus;
  };
  for (double along = -11.5; along <= 11.5; along += 0.5) {
    EXPECT_EQ(pairs({on_slope(1, 0, 0), on_slope(2, along, 4.6)}), 0U) << along;
    EXPECT_EQ(pairs({on_slope(1, 0, 0), on_slope(2, along, 3.1)}), 0U) << along;
    EXPECT_EQ(pairs({on_slope(1, 0, 0), on_slope(2, along, 2.9)}), 1U) << along;
  }
}

TEST(overlaps, of_many_vehicles_are_those_of_all_pairs) {
  std::vector<ObjectState> cars;
  for (int i = 0; i < 200; ++i)
    cars.push_back(car_on_road(i, std::fmod(i * 37.7, 80), std::fmod(i * 17.3, 60), i * 0.7));
  std::size_t expected = 0;
  for (std::size_t i = 0; i < cars.size(); ++i)
    for (std::size_t j = i + 1; j < cars.size(); ++j)
      expected += footprints_overlap(footprint(cars[i].box), footprint(cars[j].box));
  EXPECT_GT(expected, 50U);
  EXPECT_EQ(pairs(cars), expected);
}

}  // namespace
}  // namespace infrasim
