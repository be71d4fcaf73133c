#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "infrasim/core/geometry.h"
#include "infrasim/scene/lane_network.h"
#include "infrasim/scene/overlaps.h"
#include "infrasim/scene/region.h"
#include "infrasim/scene/static_world.h"
#include "infrasim/scene/traffic_signals.h"
#include "infrasim/scene/traffic_state.h"
#include "infrasim/scene/trajectory_text.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::configs;
using testing::empty_road;
using testing::error_of;
using testing::simulate_traffic;

SceneConfig committed(const std::string& name, double duration_s) {
  SceneConfig scene = read_scene(configs() / "scenes" / (name + ".yaml"));
  scene.duration_s = duration_s;
  return scene;
}

/// Trajectories of a shipped scene over its whole 500 s.
class committed_traffic : public ::testing::TestWithParam<const char*> {
 protected:
  const SceneConfig scene = committed(GetParam(), 500);
  const Trajectories trajectories = simulate_traffic(build_site(scene));
};

INSTANTIATE_TEST_SUITE_P(scenes, committed_traffic,
                         ::testing::Values("highway", "crossroad", "curve"),
                         [](const auto& scene) { return std::string(scene.param); });

double mean_speed(const std::vector<ObjectState>& row) {
  double sum = 0;
  for (const ObjectState& s : row) sum += s.speed_m_s;
  return sum / static_cast<double>(std::max<std::size_t>(1, row.size()));
}

/// Mean number of vehicles and mean speed over the rows from `from_s` to `to_s`, without `to_s`.
struct Flow {
  double vehicles = 0;
  double speed_m_s = 0;
};
Flow flow(const Trajectories& t, int from_s, int to_s) {
  Flow out;
  const double n = 10.0 * (to_s - from_s);
  for (int k = 10 * from_s; k < 10 * to_s; ++k) {
    out.vehicles += static_cast<double>(t.rows.at(k).size()) / n;
    out.speed_m_s += mean_speed(t.rows.at(k)) / n;
  }
  return out;
}

void expect_no_overlaps(const SceneConfig& scene) {
  OverlapSearch search;
  for (const auto& states : simulate_traffic(build_site(scene)).rows) search.take(states);
  for (const Overlap& o : search.overlaps())
    ADD_FAILURE() << "vehicles " << o.first_id << " and " << o.second_id << " at " << o.time_s
                  << " s, x " << o.place.x << ", y " << o.place.y;
}

TEST_P(committed_traffic, no_two_vehicles_are_in_one_place) { expect_no_overlaps(scene); }

/// Returns the footprints of the buildings, and of the legs of gantries, which are 0.5 m off the
/// carriageway.
std::vector<std::array<Vec2, 4>> standing_footprints(const SceneConfig& scene) {
  std::vector<std::array<Vec2, 4>> out;
  for (const BuildingConfig& b : scene.buildings)
    out.push_back(
        footprint({b.x_m, b.y_m, 0, b.length_m, b.width_m, b.height_m, rad(b.heading_deg)}));
  for (const GantryConfig& g : scene.gantries) {
    const RoadConfig& road = *std::ranges::find(scene.roads, g.road, &RoadConfig::name);
    const CurvePoint p = centreline(road).at(g.s_m);
    for (const double side : {1.0, -1.0}) {
      const double left = side * (carriageway_half_width(road.lanes) + 0.5);
      const Vec2 leg = p.position + left * heading_vector(p.heading + kPi / 2);
      out.push_back(footprint({leg.x, leg.y, 0, 0.4, 0.4, g.clearance_m, p.heading}));
    }
  }
  return out;
}

TEST_P(committed_traffic, no_vehicle_drives_through_what_stands) {
  const auto standing = standing_footprints(scene);
  for (std::size_t k = 0; k < trajectories.rows.size(); k += 5)
    for (const ObjectState& s : trajectories.rows[k])
      for (const auto& obstacle : standing)
        ASSERT_FALSE(footprints_overlap(footprint(s.box), obstacle)) << s.id << " at row " << k;
}

TEST_P(committed_traffic, is_made_of_many_vehicles) {
  std::set<int> ids;
  for (const auto& row : trajectories.rows)
    for (const ObjectState& s : row) ids.insert(s.id);
  EXPECT_GE(ids.size(), 300U);
}

TEST_P(committed_traffic, has_the_configured_density) {
  double lane_km = 0;
  for (const RoadConfig& road : scene.roads)
    lane_km += 2 * road.lanes.each_way * centreline(road).length() / 1000;
  const double wanted = scene.traffic->vehicles_per_km_lane * lane_km;
  EXPECT_NEAR(flow(trajectories, 0, 500).vehicles, wanted, 0.1 * wanted);
}

TEST_P(committed_traffic, is_steady_from_the_first_frame) {
  const Flow first = flow(trajectories, 0, 100), last = flow(trajectories, 400, 500);
  EXPECT_NEAR(first.vehicles, last.vehicles, 0.15 * last.vehicles);
  EXPECT_NEAR(first.speed_m_s, last.speed_m_s, 0.15 * last.speed_m_s);
}

TEST_P(committed_traffic, never_drives_backwards_nor_faster_than_drivers_wish) {
  const SpeedConfig& speed = scene.traffic->speed;
  const double fastest = (speed.mean_km_h + 2.5 * speed.std_km_h) / 3.6;
  for (const auto& row : trajectories.rows)
    for (const ObjectState& s : row) {
      ASSERT_GE(s.speed_m_s, 0);
      ASSERT_LE(s.speed_m_s, 1.01 * fastest);
    }
}

/// Calls check(before, after, seconds) for each vehicle in each pair of consecutive rows.
template <class Check>
void for_each_step(const Trajectories& t, const Check& check) {
  for (int k = 0; k < t.steps(); ++k) {
    auto before = t.rows[k].begin();
    for (const ObjectState& after : t.rows[k + 1]) {
      while (before != t.rows[k].end() && before->id < after.id) ++before;
      if (before != t.rows[k].end() && before->id == after.id) check(*before, after, 0.1 * k);
    }
  }
}

TEST_P(committed_traffic, moves_as_far_as_its_speed_says) {
  int wrong = 0;
  for_each_step(trajectories, [&](const ObjectState& a, const ObjectState& b, double t) {
    const double moved = std::hypot(b.box.x - a.box.x, b.box.y - a.box.y) / kRowStep_s;
    const double stated = (a.speed_m_s + b.speed_m_s) / 2;
    // In a bend, a driver beside the lane's centre line covers a longer or shorter distance than
    // along the centre line.
    if (std::abs(moved - stated) > 0.1 * stated + 0.05 && ++wrong <= 5)
      ADD_FAILURE() << "vehicle " << a.id << " at " << t << " s: " << moved << " m/s, said "
                    << stated << ", x " << a.box.x << ", y " << a.box.y;
  });
  EXPECT_EQ(wrong, 0);
}

TEST_P(committed_traffic, looks_where_it_goes) {
  int wrong = 0;
  for_each_step(trajectories, [&](const ObjectState& a, const ObjectState& b, double t) {
    const Vec2 step{b.box.x - a.box.x, b.box.y - a.box.y};
    if (norm(step) < 0.2) return;
    const double aside = wrap_angle(std::atan2(step.y, step.x) - a.box.heading);
    if (std::abs(aside) > rad(15) && ++wrong <= 5)
      ADD_FAILURE() << "vehicle " << a.id << " at " << t << " s: " << deg(aside) << " deg aside, x "
                    << a.box.x << ", y " << a.box.y;
  });
  EXPECT_EQ(wrong, 0);
}

TEST_P(committed_traffic, accelerates_as_vehicles_can) {
  int wrong = 0;
  for_each_step(trajectories, [&](const ObjectState& a, const ObjectState& b, double t) {
    const double acceleration = (b.speed_m_s - a.speed_m_s) / kRowStep_s;
    if ((acceleration < -8.01 || acceleration > 3) && ++wrong <= 5)
      ADD_FAILURE() << "vehicle " << a.id << " at " << t << " s: " << acceleration << " m/s2";
  });
  EXPECT_EQ(wrong, 0);
}

TEST_P(committed_traffic, has_the_configured_mix_of_classes) {
  std::map<std::string, double> share;
  std::set<int> ids;
  for (const auto& row : trajectories.rows)
    for (const ObjectState& s : row)
      if (ids.insert(s.id).second) ++share[std::string(class_of(s.object_class).name)];
  for (const auto& [name, wanted] : scene.traffic->class_shares) {
    const double n = static_cast<double>(ids.size());
    EXPECT_NEAR(share[name] / n, wanted, 4 * std::sqrt(wanted * (1 - wanted) / n)) << name;
  }
}

TEST(traffic, of_equal_seeds_is_equal_and_of_others_is_not) {
  SceneConfig scene = committed("crossroad", 20);
  const std::string once = trajectories_csv(simulate_traffic(build_site(scene)));
  EXPECT_EQ(trajectories_csv(simulate_traffic(build_site(scene))), once);
  scene.seed = 2;
  EXPECT_NE(trajectories_csv(simulate_traffic(build_site(scene))), once);
}

TEST(traffic, of_a_shorter_run_is_the_start_of_a_longer_one) {
  const std::string longer = trajectories_csv(simulate_traffic(build_site(committed("curve", 20))));
  EXPECT_TRUE(
      longer.starts_with(trajectories_csv(simulate_traffic(build_site(committed("curve", 10))))));
}

TEST(traffic, drives_on_the_right) {
  SceneConfig scene = empty_road();
  scene.traffic->vehicles_per_km_lane = 20;
  for (const auto& row : simulate_traffic(build_site(scene)).rows)
    for (const ObjectState& s : row) EXPECT_LT(s.box.y * std::cos(s.box.heading), 0);
}

TEST(traffic, stands_on_the_road) {
  SceneConfig scene = empty_road();
  scene.roads.front().elevation_m = 3;
  scene.traffic->vehicles_per_km_lane = 20;
  const Trajectories t = simulate_traffic(build_site(scene));
  for (const ObjectState& s : t.rows.front()) EXPECT_NEAR(s.box.z - s.box.dz / 2, 3, 1e-4);
}

TEST(traffic, passes_between_the_legs_of_a_gantry_and_beside_a_house) {
  SceneConfig scene = empty_road();
  scene.traffic->vehicles_per_km_lane = 20;
  scene.gantries.emplace_back().road = "road";
  scene.gantries.back().s_m = 200;
  scene.buildings.emplace_back().y_m = 8.6;  // 0.1 m from the lane
  const auto standing = standing_footprints(scene);
  ASSERT_EQ(standing.size(), 3U);
  for (const auto& row : simulate_traffic(build_site(scene)).rows)
    for (const ObjectState& s : row)
      for (const auto& obstacle : standing)
        EXPECT_FALSE(footprints_overlap(footprint(s.box), obstacle)) << s.id;
}

TEST(crossroad, has_queues_before_its_signals) {
  const Trajectories t = simulate_traffic(build_site(committed("crossroad", 200)));
  double standing = 0, all = 0;
  for (const auto& row : t.rows)
    for (const ObjectState& s : row) {
      standing += s.speed_m_s < 0.1;
      ++all;
    }
  EXPECT_GT(standing / all, 0.1);
  EXPECT_LT(standing / all, 0.8);
}

// With seed 10, a truck of 6.7 m turned right at 271 s into a bus that went straight on beside it.
TEST(crossroad, no_turning_truck_swings_into_the_lane_beside_it) {
  SceneConfig scene = committed("crossroad", 280);
  scene.seed = 10;
  expect_no_overlaps(scene);
}

SceneConfig committed_with(const std::string& name, const std::vector<std::string>& assignments) {
  return read_scene(configs() / "scenes" / (name + ".yaml"), assignments);
}

// At 460 s, two buses side by side overlapped in the bend.
TEST(traffic, long_vehicles_side_by_side_in_a_bend_stay_in_their_lanes) {
  expect_no_overlaps(committed_with("curve", {"traffic.class_shares={Bus: 1}"}));
}

// At 244 s, a truck of less than 6 m turned right into a truck that went straight on beside it.
TEST(crossroad, long_vehicles_turn_where_they_stay_in_their_lanes) {
  expect_no_overlaps(committed_with("crossroad", {"traffic.class_shares={Truck: 0.5, Bus: 0.5}"}));
}

TEST(traffic, as_dense_as_is_allowed_starts_without_overlaps) {
  for (const char* name : {"highway", "crossroad", "curve"})
    expect_no_overlaps(
        committed_with(name, {"traffic.class_shares={Bus: 1}", "traffic.vehicles_per_km_lane=80",
                              "traffic.warm_up_s=0", "duration_s=30"}));
}

TEST(traffic, that_is_fast_sees_a_queue_from_far_enough_to_stop) {
  expect_no_overlaps(
      committed_with("crossroad", {"traffic.speed.mean_km_h=200", "traffic.speed.std_km_h=50",
                                   "roads.0.centreline.0.line_m=2000", "roads.0.start.x_m=-1700",
                                   "traffic.vehicles_per_km_lane=5", "duration_s=200"}));
}

TEST(crossroad, no_vehicle_stands_on_the_junction) {
  const Trajectories t = simulate_traffic(build_site(committed("crossroad", 200)));
  for (const auto& row : t.rows)
    for (const ObjectState& s : row) {
      const bool inside = std::abs(s.box.x) < 7 && std::abs(s.box.y) < 7;
      ASSERT_TRUE(!inside || s.speed_m_s > 0.5) << s.id;
    }
}

TEST(crossroad, has_vehicles_that_turn_left_and_right_and_go_straight_on) {
  std::map<int, double> first, last;
  for (const auto& row : simulate_traffic(build_site(committed("crossroad", 300))).rows)
    for (const ObjectState& s : row) {
      first.try_emplace(s.id, s.box.heading);
      last[s.id] = s.box.heading;
    }
  int left = 0, right = 0, straight = 0;
  for (const auto& [id, heading] : last) {
    const double turned = deg(wrap_angle(heading - first[id]));
    left += std::abs(turned - 90) < 5;
    right += std::abs(turned + 90) < 5;
    straight += std::abs(turned) < 5;
  }
  EXPECT_GE(left, 10);
  EXPECT_GE(right, 10);
  EXPECT_GT(straight, left + right);
}

/// Returns a scene with a road along x with two lanes each way, and a road that ends on it from the
/// south at an angle.
SceneConfig t_junction(int lanes, double angle_deg) {
  SceneConfig scene = empty_road();
  scene.duration_s = 300;
  scene.roads[0].lanes.each_way = 2;
  RoadConfig side;
  side.name = "side";
  const Vec2 start = -200.0 * heading_vector(rad(angle_deg));
  side.start = {start.x, start.y, angle_deg};
  side.centreline.push_back({.line_m = 199});
  side.lanes.each_way = lanes;
  scene.roads.push_back(side);
  JunctionConfig junction;
  junction.roads = {"road", "side"};
  scene.junctions.push_back(junction);
  scene.traffic->vehicles_per_km_lane = 15;
  scene.traffic->warm_up_s = 60;
  scene.traffic->class_shares = {{"Car", 0.8}, {"Truck", 0.1}, {"Bus", 0.1}};
  return scene;
}

/// Returns a scene with a roundabout, at which a road along x with one lane each way meets another
/// road.
SceneConfig roundabout(double radius_m, double angle_deg, bool ends_there) {
  SceneConfig scene = t_junction(1, angle_deg);
  scene.roads[0].lanes.each_way = 1;
  if (!ends_there) scene.roads[1].centreline[0].line_m = 400;
  scene.junctions[0].roundabout = RoundaboutConfig{.radius_m = radius_m};
  scene.junctions[0].left_share = scene.junctions[0].right_share = 0.3;
  return scene;
}

/// Returns the number of vehicles on each way through the junction. A way is named by its start and
/// end: w(est), e(ast), s(outh).
std::map<std::string, int> ways(const SceneConfig& scene) {
  const auto arm = [](const Box3d& box) { return box.y < -15 ? 's' : box.x < 0 ? 'w' : 'e'; };
  std::map<int, std::string> way;
  for (const auto& states : simulate_traffic(build_site(scene)).rows)
    for (const ObjectState& s : states) {
      std::string& arms = way.try_emplace(s.id, 2, arm(s.box)).first->second;
      if (std::hypot(s.box.x, s.box.y) > 30) arms[1] = arm(s.box);
    }
  std::map<std::string, int> out;
  for (const auto& [id, arms] : way) ++out[arms];
  return out;
}

TEST(t_junction, every_way_is_driven_and_no_two_vehicles_are_in_one_place) {
  for (const int lanes : {1, 2})
    for (const double angle : {90.0, 60.0, 45.0}) {
      const SceneConfig scene = t_junction(lanes, angle);
      std::map<std::string, int> count = ways(scene);
      for (const char* way : {"we", "ew", "ws", "es", "sw", "se"})
        EXPECT_GE(count[way], 3) << way << " of " << lanes << " lanes at " << angle;
      SCOPED_TRACE(std::to_string(lanes) + " lanes at " + std::to_string(angle));
      expect_no_overlaps(scene);
    }
}

/// Adds two roads of one lane each way that cross at (x, 0), with signals or a roundabout.
void add_crossing(SceneConfig& scene, double x, bool with_ring) {
  JunctionConfig junction;
  for (const double heading_deg : {0.0, 90.0}) {
    RoadConfig road;
    road.name = "road " + std::to_string(scene.roads.size());
    const Vec2 start = Vec2{x, 0} - 200.0 * heading_vector(rad(heading_deg));
    road.start = {start.x, start.y, heading_deg};
    road.centreline.push_back({.line_m = 400});
    junction.roads.push_back(road.name);
    scene.roads.push_back(road);
  }
  if (with_ring) junction.roundabout = RoundaboutConfig{};
  scene.junctions.push_back(junction);
}

/// Returns the number of vehicles that pass within 15 m of (x, 0).
std::size_t passing(const Trajectories& trajectories, double x) {
  std::set<int> ids;
  for (const auto& row : trajectories.rows)
    for (const ObjectState& s : row)
      if (std::hypot(s.box.x - x, s.box.y) < 15) ids.insert(s.id);
  return ids.size();
}

/// Returns the number of vehicles that pass a junction with signals (false) and a junction with a
/// roundabout (true). Each number is the mean over three seeds and over the junctions of its kind
/// in the scene. The junctions are 2 km apart.
std::map<bool, double> flows(const std::vector<bool>& with_ring) {
  SceneConfig scene = empty_road();
  scene.roads.clear();
  scene.duration_s = 300;
  scene.traffic->vehicles_per_km_lane = 25;
  scene.traffic->warm_up_s = 60;
  const auto place = [](std::size_t i) { return 2000.0 * static_cast<double>(i); };
  for (std::size_t i = 0; i < with_ring.size(); ++i) add_crossing(scene, place(i), with_ring[i]);
  std::map<bool, double> sum, count;
  for (scene.seed = 1; scene.seed <= 3; ++scene.seed) {
    const Trajectories trajectories = simulate_traffic(build_site(scene));
    for (std::size_t i = 0; i < with_ring.size(); ++i) {
      sum[with_ring[i]] += static_cast<double>(passing(trajectories, place(i)));
      ++count[with_ring[i]];
    }
  }
  for (auto& [ring, vehicles] : sum) vehicles /= count[ring];
  return sum;
}

TEST(junctions, pass_as_many_vehicles_as_each_alone) {
  const bool signal = false, ring = true;
  const std::map<bool, double> alone{{signal, flows({signal})[signal]},
                                     {ring, flows({ring})[ring]}};
  for (const std::vector<bool>& with_ring :
       {std::vector<bool>{signal, signal}, {signal, ring}, {signal, ring, ring, signal, ring}})
    for (const auto& [kind, vehicles] : flows(with_ring)) {
      EXPECT_GE(vehicles, 60);
      EXPECT_NEAR(vehicles, alone.at(kind), 0.1 * alone.at(kind))
          << (kind == ring ? "roundabouts" : "signals") << " of " << with_ring.size();
    }
}

TEST(junctions, look_at_as_many_lanes_as_each_alone) {
  const auto near = [](std::size_t count) {
    SceneConfig scene = empty_road();
    scene.roads.clear();
    for (std::size_t i = 0; i < count; ++i)
      add_crossing(scene, 2000.0 * static_cast<double>(i), i % 2 == 1);
    const Site site = build_site(scene);
    std::vector<std::size_t> lanes;
    for (const auto& of_junction : TrafficState(site.network).near)
      lanes.push_back(of_junction.size());
    return lanes;
  };
  const std::vector<std::size_t> few = near(2), many = near(20);
  ASSERT_EQ(many.size(), 20U);
  for (std::size_t i = 0; i < many.size(); ++i) EXPECT_EQ(many[i], few[i % 2]) << i;
}

TEST(roundabout, is_looked_at_once_a_step_for_all_vehicles_of_an_approach) {
  const Site site = build_site(roundabout(15, 90, false));
  const LaneNetwork& network = site.network;
  TrafficState state(network);
  TrafficSignals signals(network);
  signals.find_gaps(state);
  const auto green = [&] {
    std::size_t count = 0;
    for (std::size_t a = 0; a < network.approach_junctions.size(); ++a)
      count += signals.is_green(static_cast<int>(a)) ? 1 : 0;
    return count;
  };
  const std::size_t all = green();
  EXPECT_EQ(all, network.approach_junctions.size());
  // vehicles are on all lanes around the junction
  for (std::size_t i = 0; i < network.lanes.size(); ++i) {
    if (network.lanes[i].junction < 0) continue;
    Vehicle v;
    v.lane = v.last_lane = static_cast<int>(i);
    v.s = network.lanes[i].curve.length() / 2;
    state.lanes[i].push_back(v);
  }
  EXPECT_EQ(green(), all);  // as at the beginning of the step
  signals.find_gaps(state);
  EXPECT_EQ(green(), 0U);
}

TEST(t_junction, is_also_where_a_road_begins_or_stops_short_of_the_middle) {
  SceneConfig scene = t_junction(1, 90);
  scene.roads[1].centreline[0].line_m =
      195;  // the end of the road is 5 m from the middle of the other road, on its lanes
  EXPECT_GE(ways(scene)["sw"], 3);
  scene.roads[1].start = {0, 0, -90};
  scene.roads[1].centreline[0].line_m = 200;
  EXPECT_GE(ways(scene)["sw"], 3);
  scene.roads[1].start = {0, -10, -90};
  EXPECT_NE(error_of([&] { simulate_traffic(build_site(scene)); }).find("do not meet"),
            std::string::npos);
}

TEST(t_junction, has_a_turn_for_each_lane_of_the_road_that_ends) {
  const std::string message = error_of([] { simulate_traffic(build_site(t_junction(3, 90))); });
  EXPECT_NE(message.find("got lanes without a turn: 1"), std::string::npos) << message;
}

TEST(roundabout, every_way_is_driven_around_the_island_and_no_two_vehicles_are_in_one_place) {
  for (const double radius : {12.0, 20.0})
    for (const double angle : {90.0, 60.0})
      for (const bool ends_there : {true, false}) {
        SCOPED_TRACE(std::to_string(radius) + " m at " + std::to_string(angle));
        const SceneConfig scene = roundabout(radius, angle, ends_there);
        expect_no_overlaps(scene);
        std::map<std::string, int> count = ways(scene);
        for (const char* way : {"we", "ew", "ws", "es", "sw", "se"})
          EXPECT_GE(count[way], 3) << way;
        double nearest = kInf;
        for (const auto& states : simulate_traffic(build_site(scene)).rows)
          for (const ObjectState& s : states)
            nearest = std::min(nearest, std::hypot(s.box.x, s.box.y) - s.box.dy / 2);
        EXPECT_GT(nearest, radius - 3);
      }
}

TEST(roundabout, is_driven_counter_clockwise_by_long_vehicles_too) {
  const SceneConfig scene = roundabout(15, 90, false);
  std::set<std::string> classes;
  for (const auto& states : simulate_traffic(build_site(scene)).rows)
    for (const ObjectState& s : states) {
      const double away = std::hypot(s.box.x, s.box.y);
      if (std::abs(away - 15) > 1) continue;
      classes.insert(std::string(class_of(s.object_class).name));
      const double tangent = std::atan2(s.box.y, s.box.x) + kPi / 2;
      EXPECT_LT(std::abs(deg(wrap_angle(s.box.heading - tangent))), 45);
    }
  EXPECT_EQ(classes, (std::set<std::string>{"Car", "Truck", "Bus"}));
}

TEST(roundabout, is_in_the_region_and_its_island_in_the_mesh) {
  SceneConfig scene = roundabout(20, 90, false);
  scene.region_half_length_m = 100;
  const EvaluationRegion region = testing::region_of(scene);
  const Vec2 away = heading_vector(kPi / 4);
  for (int degrees = 0; degrees < 360; degrees += 5)
    EXPECT_TRUE(region.contains(22.9 * heading_vector(rad(degrees)), Class::kCar)) << degrees;
  EXPECT_FALSE(region.contains(23.1 * away, Class::kCar));
  EXPECT_FALSE(region.contains(16.9 * away, Class::kCar));
  EXPECT_NE(region.roads_csv().find("\nroad_side_ring,"), std::string::npos);
  const TriangleMesh mesh = to_level(build_static_surface(build_site(scene)), {});
  std::map<std::string, double> top;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i)
    for (const std::uint32_t corner : mesh.triangles[i]) {
      const auto& p = mesh.vertices[corner];
      if (std::abs(std::hypot(p[0], p[1]) - 23.5) < 0.01) top["edge"] = p[2];
      if (std::abs(std::hypot(p[0], p[1]) - 16.85) < 0.01) top["island"] = p[2];
    }
  EXPECT_EQ(top.at("edge"), 0);
  EXPECT_NEAR(top.at("island"), 0.3, 1e-6);
}

TEST(roundabout, needs_one_lane_each_way_and_arms_that_are_apart) {
  SceneConfig wide = roundabout(15, 90, false);
  wide.roads[0].lanes.each_way = 2;
  EXPECT_NE(error_of([&] { simulate_traffic(build_site(wide)); }).find("one lane each way"),
            std::string::npos);
  const std::string message =
      error_of([] { simulate_traffic(build_site(roundabout(15, 50, false))); });
  EXPECT_NE(message.find("got arms at 50 degrees"), std::string::npos) << message;
}

TEST(one_way_road, is_driven_along_its_centreline_alone) {
  SceneConfig scene = t_junction(2, 90);
  scene.roads[1].lanes.one_way = true;
  std::map<std::string, int> count = ways(scene);
  EXPECT_GE(count["sw"], 3);
  EXPECT_GE(count["se"], 3);
  EXPECT_EQ(count["ws"] + count["es"], 0);
  expect_no_overlaps(scene);
  for (const auto& row : simulate_traffic(build_site(scene)).rows)
    for (const ObjectState& s : row)
      if (s.box.y < -30) {
        EXPECT_LT(std::abs(s.box.x), scene.roads[1].lanes.width_m);
        EXPECT_NEAR(s.box.heading, kPi / 2, 0.01);
      }
}

TEST(one_way_road, joins_one_that_is_one_way_and_leads_away_from_another) {
  SceneConfig scene = t_junction(1, 90);
  for (RoadConfig& road : scene.roads) road.lanes.one_way = true;
  EXPECT_GE(ways(scene)["se"], 3);
  scene.roads[0].lanes.one_way.reset();
  scene.roads[1].start = {0, 0, -90};
  EXPECT_GE(ways(scene)["ws"], 3);
}

TEST(one_way_road, needs_a_turn_for_each_lane_that_joins_it) {
  SceneConfig scene = t_junction(2, 90);
  scene.roads[0].lanes.one_way = true;
  const std::string message = error_of([&] { simulate_traffic(build_site(scene)); });
  EXPECT_NE(message.find("got lanes without a turn: 1"), std::string::npos) << message;
}

TEST(crossroad, of_45_degrees_has_turns_and_no_two_vehicles_in_one_place) {
  SceneConfig scene = t_junction(2, 45);
  scene.roads[1].centreline[0].line_m = 400;
  std::map<std::string, int> count = ways(scene);
  EXPECT_GE(count["ws"], 1);
  EXPECT_GE(count["es"], 1);
  expect_no_overlaps(scene);
}

}  // namespace
}  // namespace infrasim
