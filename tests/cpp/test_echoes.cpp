#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "infrasim/config/lidar_changes.h"
#include "infrasim/io/kitti.h"
#include "infrasim/pipeline/fusion.h"
#include "infrasim/pipeline/simulate.h"
#include "infrasim/sensor/beam.h"
#include "infrasim/sensor/echo_merge.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using namespace testing;

World short_run_of(const std::string& scene) {
  const std::vector<std::string> assignments{"duration_s=5", "traffic.warm_up_s=20"};
  return build_world(
      read_scene(configs() / "scenes" / (scene + ".yaml"), assignments, "datasheet"));
}

/// Returns a LiDAR with beams of 0.4 x 0.2 degrees, which looks 0 to 20 degrees down.
LidarConfig wide_lidar(BeamWhere where = BeamWhere::kMoving) {
  LidarConfig lidar = plain_lidar("lidar", spinning(41, -20, 0, 0.5));
  ReturnsConfig& returns = lidar.units.front().returns;
  returns.detection.emplace().range_at_10_percent_m = 1000;
  returns.beam = BeamConfig{.vertical_deg = 0.4, .horizontal_deg = 0.2, .where = where};
  return lidar;
}

double square(double x) { return x * x; }

LidarConfig with_echoes(LidarConfig lidar, EchoMode mode, double separation_m = 0.5) {
  lidar.units.front().returns.echoes =
      EchoesConfig{.mode = mode, .separation_m = separation_m, .offered = {}};
  return lidar;
}

// --- beams ---

TEST(beam, has_the_shape_of_an_even_ellipse) {
  for (const int across : {3, 5, 9}) {
    const BeamConfig config{.vertical_deg = 0.4, .horizontal_deg = 0.2, .sub_rays = across};
    const Beam beam(config, rotation(0, 0, 0));
    RayBatch ray, sub_rays;
    ray.resize(1);
    ray.dx[0] = 1;
    beam.expand(ray, std::array{0U}, 0, beam.sub_rays(), sub_rays);
    ASSERT_EQ(sub_rays.size(), 1 + 3 * (across / 2) * (across / 2 + 1));
    EXPECT_EQ(sub_rays.dx[0], 1);
    for (const std::span<const float> shares : {beam.shares(), beam.probe_shares()}) {
      double sum = 0, left = 0, up = 0;
      for (std::size_t i = 0; i < shares.size(); ++i) {
        const double y = sub_rays.dy[i] / sub_rays.dx[i] / std::tan(rad(0.1));
        const double z = sub_rays.dz[i] / sub_rays.dx[i] / std::tan(rad(0.2));
        EXPECT_LT(std::hypot(y, z), 1);
        sum += shares[i];
        left += shares[i] * y * y;
        up += shares[i] * z * z;
      }
      EXPECT_NEAR(sum, 1, 1e-6);
      // The mean square distance of the points of a uniform unit disc from its diameter is 1/4.
      EXPECT_NEAR(left, 0.25, 0.005);
      EXPECT_NEAR(up, 0.25, 0.005);
    }
    EXPECT_EQ(beam.probes(), across == 3 ? 4U : beam.sub_rays());
  }
}

TEST(beam, that_is_long_and_thin_is_probed_at_both_ends) {
  const Beam beam(BeamConfig{.vertical_deg = 0.28, .horizontal_deg = 0.03}, rotation(0, 0, 0));
  RayBatch ray, sub_rays;
  ray.resize(1);
  ray.dx[0] = 1;
  ASSERT_EQ(beam.probes(), 3U);
  beam.expand(ray, std::array{0U}, 0, 3, sub_rays);
  double sum = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(sub_rays.dy[i], 0, 1e-7);
    sum += beam.probe_shares()[i] * square(sub_rays.dz[i] / std::tan(rad(0.14)));
  }
  EXPECT_NEAR(sub_rays.dz[1], -sub_rays.dz[2], 1e-7);
  EXPECT_NEAR(sum, 0.25, 0.001);
}

TEST(beam, that_meets_no_moving_object_is_a_ray) {
  SceneConfig scene = empty_road();
  scene.ground.push_back(ground_at(-0.001));
  scene.buildings.emplace_back().x_m = 25;
  scene.buildings.back().y_m = 20;
  LidarConfig ray = wide_lidar();
  ray.units.front().returns.beam.reset();
  // Beams on the car are cast as sub-rays. All other points are the same as with beams of one ray.
  const World world = world_with(scene, {car_on_road(1, -12, -3, 0)});
  const Frame wide = frame_of(world, wide_lidar()), narrow = frame_of(world, ray);
  std::map<std::pair<float, int>, float> range;  // by time and ring
  const auto key = [](const PointCloud& cloud, std::size_t i) {
    return std::pair{cloud.time[i], int{cloud.ring[i]}};
  };
  for (std::size_t i = 0; i < narrow.cloud.size(); ++i)
    range[key(narrow.cloud, i)] = static_cast<float>(norm(point(narrow.cloud, i)));
  int same = 0, other = 0;
  for (std::size_t i = 0; i < wide.cloud.size(); ++i) {
    const auto ray_range = range.find(key(wide.cloud, i));
    (ray_range != range.end() && ray_range->second == static_cast<float>(norm(point(wide.cloud, i)))
         ? same
         : other) += 1;
  }
  const int on_car = static_cast<int>(std::ranges::count(wide.cloud.object_id, 1));
  EXPECT_GT(on_car, 50);
  EXPECT_GT(same, 10'000);
  EXPECT_LT(other, 2 * on_car);
  EXPECT_EQ(wide.cloud.size(), narrow.cloud.size());
}

TEST(beam, sees_as_much_of_moving_objects_as_with_sub_rays_everywhere) {
  SceneConfig scene = empty_road();
  scene.roads.front().start.y_m = -1000;  // nothing behind the vehicles
  std::vector<ObjectState> cranes;
  for (const Vec2 at : {Vec2{-30, -3}, Vec2{25, 14}, Vec2{40, -20}, Vec2{0, 60}}) {
    cranes.push_back(car_on_road(static_cast<int>(cranes.size()), at.x, at.y, 0.7));
    cranes.back().box.dz = 12;
    cranes.back().box.z = 6;
  }
  const World world = world_with(scene, cranes);
  const Frame near = frame_of(world, wide_lidar());
  EXPECT_GT(near.cloud.size(), 900U);
  const auto everywhere = frame_of(world, wide_lidar(BeamWhere::kEverywhere)).cloud.size();
  EXPECT_NEAR(static_cast<double>(near.cloud.size()), static_cast<double>(everywhere),
              0.02 * static_cast<double>(everywhere));
}

TEST(beam, of_more_sub_rays_sees_nearly_the_same) {
  const World world = short_run_of("highway");
  for (const BeamWhere where : {BeamWhere::kMoving, BeamWhere::kEverywhere}) {
    LidarConfig lidar = read_lidar(configs() / "lidars/helios_16.yaml", "datasheet");
    const auto points = [&](int sub_rays) {
      BeamConfig& beam = *lidar.units.front().returns.beam;
      beam.sub_rays = sub_rays;
      beam.where = where;
      int sum = 0;
      for (const ObjectRecord& object : frame_of(world, lidar, 3).objects) sum += object.points;
      return sum;
    };
    const int few = points(3);
    EXPECT_GT(few, 100);
    for (const int many : {5, 9}) EXPECT_NEAR(points(many), few, 0.05 * few);
  }
}

TEST(beam, beside_a_car_sees_it) {
  const World world = world_with(empty_road(), {car_on_road(1, -50, -3, 0)});
  LidarConfig ray = wide_lidar();
  ray.units.front().returns.beam.reset();
  const auto points = [&](const LidarConfig& lidar) {
    return frame_of(world, lidar).objects.at(0).points;
  };
  EXPECT_GT(points(wide_lidar()), points(ray));
}

// --- merging ---

/// Returns the merged echoes of a beam of equal sub-rays, the strongest echo first.
std::vector<Echo> merged(const std::vector<Echo>& of_sub_rays, double separation_m,
                         const EchoPath& path = {}) {
  EchoBatch sub_echoes, echoes;
  sub_echoes.resize(of_sub_rays.size());
  echoes.resize(1);
  for (std::size_t i = 0; i < of_sub_rays.size(); ++i) sub_echoes.set(i, of_sub_rays[i]);
  const std::vector<SubRay> sub_rays(of_sub_rays.size(),
                                     {0, 1.F / static_cast<float>(of_sub_rays.size())});
  std::vector<float> sunlit(1);
  std::vector<WeakerEcho> others;
  EchoMerger(separation_m, path)
      .merge(sub_rays, sub_echoes, {}, std::array{0U}, std::array<std::uint16_t, 1>{}, echoes,
             sunlit, &others);
  std::vector<Echo> out{echoes.at(0)};
  for (const WeakerEcho& other : others) out.push_back(other.echo);
  return out;
}

TEST(echoes, nearer_than_the_separation_are_one_between_the_surfaces) {
  const std::vector<Echo> both{{20, 1, 0, 0.5F, 1}, {20.8F, 2, 0, 0.5F, 1}};
  ASSERT_EQ(merged(both, 1).size(), 1U);
  EXPECT_GT(merged(both, 1)[0].range, 20.3F);
  EXPECT_LT(merged(both, 1)[0].range, 20.4F);  // the nearer echo is stronger
  ASSERT_EQ(merged(both, 0.7).size(), 2U);
  EXPECT_EQ(merged(both, 0.7)[0].range, 20);
  EXPECT_EQ(merged(both, 0.7)[1].object, 2);
  EXPECT_FLOAT_EQ(merged(both, 0.7)[1].reflectance, 0.25F) << "half of the beam";
}

TEST(echoes, are_in_the_order_of_strength_after_the_air_and_beyond_the_blind_zone) {
  const std::vector<Echo> three{
      {50, 1, 0, 0.1F, 1}, {0.5F, 3, 0, 0.2F, 1}, {100, 2, 0, 0.9F, 1}, {100.2F, 2, 0, 0.9F, 1}};
  const auto objects = [&](const EchoPath& path) {
    std::vector<int> out;
    for (const Echo& echo : merged(three, 0.5, path)) out.push_back(echo.object);
    return out;
  };
  EXPECT_EQ(objects({}), (std::vector{3, 2, 1}));
  EXPECT_EQ(objects({.min_range_m = 1}), (std::vector{2, 1}));
  EXPECT_EQ(objects({.min_range_m = 1, .extinction_per_m = 0.02}), (std::vector{1, 2}));
  constexpr std::array<float, 1> kBlind{60};
  EXPECT_EQ(objects({.min_range_by_ring_m = kBlind}), (std::vector{2}))
      << "the blind zone of the channel counts";
}

// --- frames with several echoes ---

using RayKey = std::pair<float, int>;  // time and ring

/// Returns the ranges of the points of each ray, in the order of the points.
std::map<RayKey, std::vector<double>> by_ray(const Frame& frame) {
  std::map<RayKey, std::vector<double>> out;
  for (std::size_t i = 0; i < frame.cloud.size(); ++i)
    out[{frame.cloud.time[i], frame.cloud.ring[i]}].push_back(norm(point(frame.cloud, i)));
  return out;
}

/// Returns a world with a car in front of a truck, so that many beams meet both.
World car_before_truck() {
  SceneConfig scene = empty_road();
  ObjectState truck = car_on_road(2, -40, -3, 0);
  truck.box.dy = 12;
  truck.box.dz = 8;
  truck.box.z = 4;
  return world_with(scene, {car_on_road(1, -30, -3, 0), truck});
}

TEST(echoes, of_beams_on_two_vehicles_are_the_first_the_last_or_both) {
  const World world = car_before_truck();
  const LidarConfig lidar = wide_lidar();
  const auto strongest = by_ray(frame_of(world, with_echoes(lidar, EchoMode::kStrongest)));
  const auto first = by_ray(frame_of(world, with_echoes(lidar, EchoMode::kFirst)));
  const auto last = by_ray(frame_of(world, with_echoes(lidar, EchoMode::kLast)));
  const auto dual = by_ray(frame_of(world, with_echoes(lidar, EchoMode::kDual)));
  int both = 0;
  for (const auto& [ray, ranges] : dual) {
    ASSERT_EQ(first.at(ray).size(), 1U);
    ASSERT_EQ(last.at(ray).size(), 1U);
    EXPECT_EQ(strongest.at(ray), std::vector{ranges[0]});
    EXPECT_LE(first.at(ray)[0], std::ranges::min(ranges)) << "of three or more echoes";
    EXPECT_EQ(last.at(ray)[0], std::ranges::max(ranges));
    if (ranges.size() == 1) continue;
    ASSERT_EQ(ranges.size(), 2U);
    EXPECT_GT(std::abs(ranges[0] - ranges[1]), 0.5);
    ++both;
  }
  EXPECT_GT(both, 10);
  EXPECT_EQ(strongest.size(), dual.size());
}

TEST(echoes, two_of_a_ray_are_marked_and_follow_each_other) {
  const Frame frame = frame_of(car_before_truck(), with_echoes(wide_lidar(), EchoMode::kDual));
  const PointCloud& cloud = frame.cloud;
  EXPECT_GT(std::ranges::count(cloud.echo, 1), 10);
  EXPECT_EQ(cloud.echo[0], 0);
  for (std::size_t i = 1; i < cloud.size(); ++i) {
    const bool same = cloud.time[i] == cloud.time[i - 1] && cloud.ring[i] == cloud.ring[i - 1];
    EXPECT_EQ(cloud.echo[i], same ? 1 : 0);
  }
  const auto bytes = fields_bytes(cloud);
  for (std::size_t i = 0; i < cloud.size(); ++i)
    EXPECT_EQ(static_cast<int>(bytes[12 * i + 7]), cloud.echo[i]);
}

TEST(echoes, two_on_one_vehicle_count_once) {
  const World world = short_run_of("crossroad");
  const LidarConfig lidar =
      with_echoes(read_lidar(configs() / "lidars/ruby_plus.yaml", "datasheet"), EchoMode::kDual);
  const Frame frame = frame_of(world, lidar, 3);
  std::map<int, std::set<RayKey>> rays;
  std::map<int, int> points;
  for (std::size_t i = 0; i < frame.cloud.size(); ++i) {
    const int id = frame.cloud.object_id[i];
    if (id < 0) continue;
    rays[id].insert({frame.cloud.time[i], frame.cloud.ring[i]});
    ++points[id];
  }
  int twice = 0;
  for (const ObjectRecord& object : frame.objects) {
    EXPECT_EQ(object.points, std::ssize(rays[object.id]));
    twice += points[object.id] - object.points;
  }
  EXPECT_GT(twice, 5);
}

TEST(echoes, two_on_one_vehicle_count_once_in_its_boxes_in_a_fused_frame) {
  const World world = world_with(empty_road(), {car_on_road(1, 12, -1.8, 0)});
  const Fusion fusion(world.scene, {&world, 1}, kUsualPeriod_s);
  const auto counts = [&](const Frame& frame) {
    const std::array frames{&frame};
    const ObjectRecord car = fusion.fuse(0, frames).frame.objects.at(0);
    return std::pair(car.points_in_box, car.points_in_scan_box);
  };
  const Frame once = frame_of(world, plain_lidar("lidar", spinning(41, -40, 0, 0.5)));
  Frame twice = once;  // copy in which each ray on the car gives a second point
  twice.cloud = {};
  for (std::size_t i = 0; i < once.cloud.size(); ++i)
    for (const bool second : {false, true}) {
      if (second && once.cloud.object_id[i] < 0) continue;
      PointCloud::for_each_column([&](auto column, std::size_t values) {
        const auto from = (once.cloud.*column).begin() + static_cast<std::ptrdiff_t>(values * i);
        auto& to = twice.cloud.*column;
        to.insert(to.end(), from, from + static_cast<std::ptrdiff_t>(values));
      });
      twice.cloud.echo.back() = second ? 1 : 0;
    }
  EXPECT_GT(twice.cloud.size(), once.cloud.size() + 20);
  EXPECT_GT(counts(once).first, 20);
  EXPECT_EQ(counts(twice), counts(once));
}

TEST(echoes, depend_neither_on_layers_nor_on_other_frames) {
  const World world = short_run_of("highway");
  for (const EchoMode mode : {EchoMode::kFirst, EchoMode::kLast, EchoMode::kDual})
    for (const char* name : {"ruby_plus", "livox_avia", "hesai_ot128"}) {
      const LidarConfig lidar = with_echoes(
          read_lidar(configs() / "lidars" / (std::string(name) + ".yaml"), "datasheet"), mode);
      FrameSimulator layered(world, std::array{lidar}), all(world, std::array{lidar}, {});
      for (const int k : {17, 3})
        expect_equal(layered.simulate(k, {true})[0].cloud, all.simulate(k, {true})[0].cloud);
    }
}

TEST(echoes, of_a_mode_that_the_sensor_does_not_offer_are_refused) {
  LidarConfig avia = read_lidar(configs() / "lidars/livox_avia.yaml", "datasheet");
  EXPECT_NE(error_of([&] {
              set_echo_mode(avia, EchoMode::kLast);
            }).find("expected a mode that the sensor offers (first, strongest, dual), got last"),
            std::string::npos);
  set_echo_mode(avia, EchoMode::kDual);
  EXPECT_NE(dump_lidar(avia).find("mode: dual"), std::string::npos);
  LidarConfig paper = read_lidar(configs() / "lidars/livox_avia.yaml", "paper");
  EXPECT_NE(error_of([&] {
              set_echo_mode(paper, EchoMode::kDual);
            }).find("expected strongest with preset paper of livox_avia"),
            std::string::npos);
  set_echo_mode(paper, EchoMode::kStrongest);
  EXPECT_NE(error_of([] { echo_mode("both"); }).find("expected strongest, first, last or dual"),
            std::string::npos);
}

}  // namespace
}  // namespace infrasim
