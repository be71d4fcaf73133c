// Tests that the evaluation region equals that of a search over the whole of each road, and that
// the time for a point does not grow with the length of the road.
#include "infrasim/scene/region.h"

#include <gtest/gtest.h>

#include <chrono>
#include <random>
#include <utility>
#include <vector>

#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::empty_road;
using testing::region_of;

/// Returns a scene with one road of the given pieces from (0, 0) to the east.
SceneConfig with_road(const std::vector<CentrelinePiece>& pieces, double half_length_m) {
  SceneConfig scene = empty_road();
  scene.roads[0].start.x_m = 0;
  scene.roads[0].centreline = pieces;
  scene.region_half_length_m = half_length_m;
  return scene;
}

/// Checks for some random points that the region gives the same result as a search over the whole
/// centreline.
void expect_as_by_search(SceneConfig scene, Vec2 foot, double yaw_deg, double spread_m) {
  MountConfig& mount = scene.mounts.begin()->second;
  mount.x_m = foot.x;
  mount.y_m = foot.y;
  mount.yaw_deg = yaw_deg;
  Curve along = centreline(scene.roads[0]);
  if (std::cos(along.at(along.project(foot)).heading - rad(yaw_deg)) < 0) along = along.reversed();
  const double foot_s = along.project(foot);
  const double half_width = carriageway_half_width(scene.roads[0].lanes);
  const EvaluationRegion region = region_of(scene);
  std::mt19937 random(7);
  std::uniform_real_distribution<double> offset(-spread_m, spread_m);
  int inside = 0, differ = 0;
  for (int i = 0; i < 4000; ++i) {
    const Vec2 point = foot + Vec2{offset(random), offset(random)};
    const double s = along.project(point);
    const double away = norm(point - along.at(s).position);
    for (const auto& [object_class, beside] :
         {std::pair{Class::kCar, 0.0}, std::pair{Class::kPedestrian, kFootways_m}}) {
      const bool by_search =
          std::abs(s - foot_s) <= scene.region_half_length_m && away <= half_width + beside;
      inside += by_search;
      differ += region.contains(point, object_class) != by_search;
    }
  }
  EXPECT_EQ(differ, 0);
  EXPECT_GT(inside, 5);
}

TEST(region, has_the_members_that_a_search_over_the_whole_road_finds) {
  const CentrelinePiece line{.line_m = 300};
  const CentrelinePiece left{.radius_m = 80, .turn_deg = 70},
      right{.radius_m = 60, .turn_deg = -90};
  const std::vector<CentrelinePiece> bends{line, left, right, line, left, left};
  for (const double half_m : {40.0, 250.0, 5000.0}) {
    SCOPED_TRACE(half_m);
    expect_as_by_search(with_road(bends, half_m), {200, 8}, 0, 400);
    expect_as_by_search(with_road(bends, half_m), {310, 12}, 170, 400);
    expect_as_by_search(with_road(bends, half_m), {0, 0}, 90, 300);
    expect_as_by_search(with_road({line}, half_m), {290, 5}, 90, 100);
  }
}

TEST(region, of_a_road_that_comes_near_itself_has_only_the_part_around_the_mount) {
  // Two hairpin bends: three parallel parts, 30 m apart.
  const CentrelinePiece line{.line_m = 200}, left{.radius_m = 15, .turn_deg = 180},
      right{.radius_m = 15, .turn_deg = -180};
  for (const double half_m : {30.0, 120.0, 220.0, 300.0}) {
    SCOPED_TRACE(half_m);
    expect_as_by_search(with_road({line, left, line, right, line}, half_m), {100, 15}, 0, 150);
    expect_as_by_search(with_road({line, left, line, right, line}, half_m), {195, 30}, 180, 150);
  }
}

/// Returns the least time (s) of five searches for 2000 points around the sensor.
double seconds_on(int bends) {
  const CentrelinePiece left{.radius_m = 400, .turn_deg = 20},
      right{.radius_m = 400, .turn_deg = -20};
  std::vector<CentrelinePiece> pieces;
  for (int i = 0; i < bends; ++i) pieces.push_back(i % 2 == 0 ? left : right);
  const EvaluationRegion region = region_of(with_road(pieces, 60));
  double least = kInf;
  int inside = 0;
  for (int repeat = 0; repeat < 5; ++repeat) {
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < 2000; ++i) inside += region.contains({i * 0.1, 3}, Class::kCar);
    const auto time = std::chrono::steady_clock::now() - start;
    least = std::min(least, std::chrono::duration<double>(time).count());
  }
  EXPECT_GT(inside, 0);
  return least;
}

TEST(region, is_found_as_fast_on_a_road_of_a_hundred_times_the_length) {
  // A search over the whole road takes a hundred times as long.
  EXPECT_LT(seconds_on(500), 20 * seconds_on(5));
}

}  // namespace
}  // namespace infrasim
