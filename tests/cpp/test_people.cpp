#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "infrasim/pipeline/world.h"
#include "infrasim/scene/overlaps.h"
#include "infrasim/scene/people.h"
#include "infrasim/scene/region.h"
#include "infrasim/scene/traffic.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::configs;
using testing::error_of;

/// Returns the scene `curve` with rows of people.
SceneConfig with_people(const std::string& rows, const std::string& duration_s = "5") {
  const std::vector<std::string> assignments{"duration_s=" + duration_s, "traffic.warm_up_s=5",
                                             "people=" + rows};
  return read_scene(configs() / "scenes/curve.yaml", assignments);
}

People people_of(const SceneConfig& scene) { return {scene, centrelines(scene)}; }

/// Pedestrians on one side of the road, and cyclists on the other side.
constexpr char kBothSides[] =
    "[{road: bend, offset_m: -11, per_km: 60, class: Pedestrian, "
    "speed: {mean_km_h: 5, std_km_h: 1}}, "
    "{road: bend, offset_m: 11, per_km: 20, class: Cyclist, "
    "speed: {mean_km_h: 16, std_km_h: 3}}]";

bool is_person(const ObjectState& s) { return s.id >= kFirstPersonId; }

TEST(people, go_both_ways_at_their_own_speeds_beside_the_road) {
  const SceneConfig scene = with_people(kBothSides);
  const std::vector<ObjectState> there = people_of(scene).at(0);
  // number and sum of speeds, by class
  std::map<std::string_view, std::pair<int, double>> by_class;
  int along = 0;
  const Curve line = centreline(scene.roads[0]);
  for (const ObjectState& s : there) {
    auto& [n, sum] = by_class[class_of(s.object_class).name];
    ++n;
    sum += s.speed_m_s;
    const CurvePoint p = line.at(line.project({s.box.x, s.box.y}));
    along += std::cos(s.box.heading - p.heading) > 0;
    EXPECT_NEAR(norm(Vec2{s.box.x, s.box.y} - p.position), 11, 2.5);
    EXPECT_NEAR(s.box.z - s.box.dz / 2, scene.roads[0].elevation_m, 1e-3);
  }
  const double km = line.length() / 1000;
  EXPECT_NEAR(by_class["Pedestrian"].first, 60 * km, 0.15 * 60 * km);
  EXPECT_NEAR(by_class["Cyclist"].first, 20 * km, 0.3 * 20 * km);
  EXPECT_NEAR(by_class["Pedestrian"].second / by_class["Pedestrian"].first, 5 / 3.6, 0.2);
  EXPECT_NEAR(by_class["Cyclist"].second / by_class["Cyclist"].first, 16 / 3.6, 0.6);
  const auto all = static_cast<double>(there.size());
  EXPECT_NEAR(along, all / 2, 0.15 * all);
}

TEST(people, come_and_go_at_the_ends_of_their_line_alone) {
  const SceneConfig scene = with_people(kBothSides);
  const People people = people_of(scene);
  Trajectories rows;
  for (int k = 0; k <= 3000; ++k) rows.rows.push_back(people.at(k * kRowStep_s));
  const Curve line = centreline(scene.roads[0]);
  std::map<int, ObjectState> before;
  int came = 0;
  for (std::size_t k = 0; k < rows.rows.size(); ++k) {
    std::map<int, ObjectState> now;
    for (const ObjectState& s : rows.rows[k]) now.emplace(s.id, s);
    ASSERT_EQ(now.size(), rows.rows[k].size());
    const auto at_an_end = [&](const ObjectState& s) {
      const double station = line.project({s.box.x, s.box.y});
      return station < 3 || station > line.length() - 3;
    };
    for (const auto& [id, s] : now) {
      if (k == 0) break;
      const auto last = before.find(id);
      came += last == before.end();
      if (last == before.end()) {
        EXPECT_TRUE(at_an_end(s)) << id;
        continue;
      }
      const Box3d &a = last->second.box, &b = s.box;
      EXPECT_NEAR(norm(Vec2{b.x - a.x, b.y - a.y}), s.speed_m_s * kRowStep_s, 0.12);
      EXPECT_LT(std::abs(wrap_angle(b.heading - a.heading)), rad(5));
      EXPECT_EQ(a.dx, b.dx);
    }
    for (const auto& [id, s] : before) EXPECT_TRUE(now.contains(id) || at_an_end(s)) << id;
    before = std::move(now);
  }
  EXPECT_GT(came, 50);
}

TEST(people, nightly_share_no_place) {
  // The highest allowed density, and the largest allowed differences of speed.
  const std::string rows =
      "[{road: bend, offset_m: -11, per_km: 60, class: Pedestrian, "
      "speed: {mean_km_h: 5, std_km_h: 1.6}}, "
      "{road: bend, offset_m: 11, per_km: 60, class: Cyclist, "
      "speed: {mean_km_h: 16, std_km_h: 5.3}}]";
  const Curve line = centreline(with_people(rows).roads[0]);
  for (const std::uint64_t seed : {1U, 2U, 3U, 4U, 5U, 6U, 7U, 8U, 9U, 10U, 11U, 12U}) {
    SceneConfig scene = with_people(rows);
    scene.seed = seed;
    const People people = people_of(scene);
    OverlapSearch search;
    double farthest = 0;
    for (int k = 0; k <= 3000; ++k) {
      const auto there = people.at(k * kRowStep_s);
      for (const ObjectState& s : there) {
        const Vec2 xy{s.box.x, s.box.y};
        farthest = std::max(farthest, std::abs(norm(xy - line.at(line.project(xy)).position) - 11));
      }
      search.take(there);
    }
    EXPECT_LT(farthest, 3);
    EXPECT_TRUE(search.overlaps().empty()) << search.overlaps().size() << " pairs, seed " << seed;
  }
}

TEST(people, are_as_many_at_all_times) {
  const People people = people_of(with_people(kBothSides));
  const auto first = static_cast<double>(people.at(0).size());
  for (int k = 0; k <= 5000; k += 100)
    EXPECT_NEAR(static_cast<double>(people.at(k * kRowStep_s).size()), first, 0.15 * first);
}

TEST(people, change_nothing_of_the_traffic_and_stand_behind_it_in_the_rows) {
  const SceneConfig scene = with_people(kBothSides);
  SceneConfig alone = scene;
  alone.people.reset();
  const World world = build_world(scene), empty = build_world(alone);
  ASSERT_EQ(world.trajectories->rows.size(), empty.trajectories->rows.size());
  for (std::size_t k = 0; k < empty.trajectories->rows.size(); ++k) {
    const auto &all = world.trajectories->rows[k], &vehicles = empty.trajectories->rows[k];
    ASSERT_GT(all.size(), vehicles.size());
    for (std::size_t i = 0; i < vehicles.size(); ++i) {
      EXPECT_EQ(all[i].id, vehicles[i].id);
      EXPECT_EQ(all[i].box.x, vehicles[i].box.x);
    }
    EXPECT_TRUE(is_person(all[vehicles.size()]));
  }
}

TEST(people, are_a_draw_of_the_seed) {
  SceneConfig scene = with_people(kBothSides);
  const double x = people_of(scene).at(0).front().box.x;
  EXPECT_EQ(people_of(scene).at(0).front().box.x, x);
  scene.seed = 2;
  EXPECT_NE(people_of(scene).at(0).front().box.x, x);
}

TEST(people, count_within_six_metres_of_the_carriageway) {
  const SceneConfig scene = with_people(kBothSides);
  const EvaluationRegion region = testing::region_of(scene);
  const Curve line = centreline(scene.roads[0]);
  const MountConfig& mount = scene.mounts.begin()->second;
  const CurvePoint p = line.at(line.project({mount.x_m, mount.y_m}));
  const double half = carriageway_half_width(scene.roads[0].lanes);
  const auto aside = [&](double m) { return p.position + m * heading_vector(p.heading + kPi / 2); };
  EXPECT_TRUE(region.contains(aside(half - 0.1), Class::kCar));
  EXPECT_FALSE(region.contains(aside(half + 0.1), Class::kCar));
  EXPECT_TRUE(region.contains(aside(half + 5.9), Class::kPedestrian));
  EXPECT_TRUE(region.contains(aside(half + 5.9), Class::kCyclist));
  EXPECT_FALSE(region.contains(aside(half + 6.1), Class::kPedestrian));
}

SceneConfig with_group(const std::string& keys) {
  const std::vector<std::string> assignments{"duration_s=1", "traffic.warm_up_s=1",
                                             "standing_people=[{" + keys + "}]"};
  return read_scene(configs() / "scenes/curve.yaml", assignments);
}

TEST(people_who_stand, are_as_many_as_asked_inside_the_radius_and_share_no_place) {
  SceneConfig scene = with_group("x_m: 3, y_m: 40, count: 50, spacing_m: 1.2, base_m: -0.2");
  const StandingPeopleConfig& group = scene.standing_people->front();
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    scene.seed = seed;
    const std::vector<ObjectState> there = standing_people(scene);
    ASSERT_EQ(there.size(), 50U);
    for (std::size_t i = 0; i < there.size(); ++i) {
      const Box3d& box = there[i].box;
      for (const Vec2& corner : footprint(box))
        EXPECT_LT(norm(corner - Vec2{group.x_m, group.y_m}), radius_of(group));
      EXPECT_NEAR(box.z - box.dz / 2, -0.2, 1e-3);
      for (std::size_t k = 0; k < i; ++k)
        EXPECT_FALSE(footprints_overlap(footprint(box), footprint(there[k].box)));
    }
  }
}

TEST(people_who_stand, stand_in_every_frame_of_the_world_after_all_others) {
  const World world = build_world(with_group("x_m: 3, y_m: 40, count: 3"));
  for (const int k : {0, world.frames(kUsualPeriod_s) - 1}) {
    const auto objects = world.objects_in_frame(k, kUsualPeriod_s);
    ASSERT_GE(objects.size(), 3U);
    for (std::size_t i = 0; i < 3; ++i) {
      const MovingObject& state = objects[objects.size() - 3 + i];
      EXPECT_EQ(state.from, state.to);
      EXPECT_EQ(state.id, kFirstStandingPersonId + static_cast<int>(i));
      EXPECT_EQ(state.object_class, Class::kPedestrian);
      EXPECT_EQ(state.speed_m_s, 0);
    }
  }
}

TEST(people_who_stand, are_refused_on_lanes_and_where_something_stands) {
  const SceneConfig free = with_group("x_m: 3, y_m: 40");
  const CurvePoint p = centreline(free.roads[0]).at(50);
  const auto place = [](const Vec2& at) {
    return "x_m: " + std::to_string(at.x) + ", y_m: " + std::to_string(at.y);
  };
  const auto error = [](const std::string& keys) {
    return error_of([&] { build_world(with_group(keys)); });
  };
  EXPECT_NE(error(place(p.position)).find("on a lane"), std::string::npos);
  const std::string twice = "x_m: 3, y_m: 40}, {x_m: 4, y_m: 40";
  EXPECT_NE(error(twice).find("expected free ground"), std::string::npos);
  EXPECT_NE(error("x_m: 3, y_m: 40, count: 51").find("count"), std::string::npos);
  EXPECT_NE(error("x_m: 3, y_m: 40, spacing_m: 1").find("spacing_m"), std::string::npos);
}

std::string refused(const std::string& row) {
  return error_of([&] { build_world(with_people("[" + row + "]")); });
}

TEST(people, in_lanes_or_in_what_stands_there_are_refused) {
  constexpr char kRest[] = ", per_km: 10, class: Pedestrian, speed: {mean_km_h: 5, std_km_h: 1}}";
  const std::string lane = refused(std::string("{road: bend, offset_m: 3") + kRest);
  EXPECT_NE(lane.find("got people on a lane"), std::string::npos) << lane;
  const std::string row = std::string("{road: bend, offset_m: 11") + kRest;
  const std::string twice = refused(row + ", " + row);
  EXPECT_NE(twice.find("got an object in the way"), std::string::npos) << twice;
  const std::string unknown = refused(std::string("{road: lane, offset_m: 11") + kRest);
  EXPECT_NE(unknown.find("got unknown road 'lane'"), std::string::npos) << unknown;
}

TEST(people, with_speeds_that_some_would_stand_still_at_are_refused) {
  const std::string message = refused(
      "{road: bend, offset_m: 11, per_km: 10, class: Cyclist, speed: {mean_km_h: 6, std_km_h: 3}}");
  EXPECT_NE(message.find("std_km_h: expected up to a third"), std::string::npos) << message;
}

TEST(people, of_other_classes_are_refused) {
  const std::string message = refused(
      "{road: bend, offset_m: 11, per_km: 10, class: Car, speed: {mean_km_h: 6, std_km_h: 1}}");
  EXPECT_NE(message.find("Pedestrian, Cyclist"), std::string::npos) << message;
}

}  // namespace
}  // namespace infrasim
