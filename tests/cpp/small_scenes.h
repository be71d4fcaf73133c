#pragma once

#include <gtest/gtest.h>
#include <stdlib.h>  // NOLINT(modernize-deprecated-headers): mkdtemp is POSIX

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/config/scene_config.h"
#include "infrasim/core/errors.h"
#include "infrasim/core/point_cloud.h"
#include "infrasim/pipeline/simulate.h"
#include "infrasim/scene/region.h"
#include "infrasim/scene/site.h"
#include "infrasim/scene/traffic.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim::testing {

/// A folder that is removed at the end of the test.
class TestFolder {
 public:
  TestFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "infrasim_test_XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("no folder " + name);
    path_ = name;
  }
  ~TestFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TestFolder(const TestFolder&) = delete;
  TestFolder& operator=(const TestFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path write(const std::string& name, std::string_view bytes) const {
    std::ofstream(path_ / name, std::ios::binary) << bytes;
    return path_ / name;
  }

 private:
  std::filesystem::path path_;
};

inline std::filesystem::path configs() {
  return std::filesystem::path(INFRASIM_SOURCE_DIR) / "configs";
}

/// Returns the message of the error that `action` must throw.
template <class Error = ConfigError, class Action>
std::string error_of(const Action& action) {
  try {
    action();
  } catch (const Error& e) {
    return e.what();
  }
  ADD_FAILURE() << "no error";
  return "";
}

/// Checks that a message contains the given words.
inline void expect_within(const std::string& message, const std::string& what) {
  EXPECT_NE(message.find(what), std::string::npos) << message << "\n  must say " << what;
}

/// Checks that a message names the file, the line (and a column) and the key, and contains the
/// given words.
inline void expect_message(const std::string& message, const std::filesystem::path& file, int line,
                           const std::string& key, const std::string& what) {
  const std::string start = file.string() + ":" + std::to_string(line) + ":";
  EXPECT_TRUE(message.starts_with(start)) << message << "\n  must start with " << start;
  EXPECT_NE(message.find(": " + key + ": "), std::string::npos) << message << "\n  key " << key;
  expect_within(message, what);
}

/// Returns a scene with one lane each way along x and a mount 6 m above the origin. It has no
/// vehicles and no other objects.
inline SceneConfig empty_road() {
  SceneConfig scene;
  scene.name = "empty_road";
  scene.duration_s = 1;
  scene.detail = Detail::kBox;
  scene.mounts["pole"];
  RoadConfig road;
  road.name = "road";
  road.start.x_m = -200;
  road.centreline.push_back({.line_m = 400});
  scene.roads.push_back(road);
  TrafficConfig traffic;
  traffic.vehicles_per_km_lane = 0;
  traffic.warm_up_s = 0;
  traffic.class_shares["Car"] = 1;
  scene.traffic = traffic;
  return scene;
}

/// Returns the evaluation region of the scene's first mount.
inline EvaluationRegion region_of(const SceneConfig& scene) {
  return EvaluationRegion(build_site(scene), scene.mounts.begin()->second);
}

/// Returns level ground of 400 x 400 m around the origin.
inline GroundConfig ground_at(double elevation_m) {
  GroundConfig ground;
  ground.elevation_m = elevation_m;
  ground.outline_m = {{-200, -200}, {200, -200}, {200, 200}, {-200, 200}};
  return ground;
}

/// Returns a car of 4.5 x 1.9 x 1.5 m on a road at z = 0.
inline ObjectState car_on_road(int id, double x, double y, double heading, double speed_m_s = 0) {
  return {id, Class::kCar, {x, y, 0.75, 4.5, 1.9, 1.5, heading}, speed_m_s};
}

/// Returns the trajectories of vehicles that each keep their speed and heading.
inline Trajectories straight_on(const std::vector<ObjectState>& at_start, int frames) {
  Trajectories out;
  for (int k = 0; k <= frames; ++k) {
    auto& row = out.rows.emplace_back(at_start);
    for (ObjectState& s : row) {
      s.box.x += s.speed_m_s * k * kRowStep_s * std::cos(s.box.heading);
      s.box.y += s.speed_m_s * k * kRowStep_s * std::sin(s.box.heading);
    }
  }
  return out;
}

/// Returns the vehicles of a scene's simulated traffic at all instants.
inline Trajectories simulate_traffic(const Site& site) {
  Trajectories out;
  TrafficSteps steps(site);
  for (int k = 0; k <= row_steps(site.scene.duration_s); ++k) out.rows.push_back(steps.next());
  return out;
}

/// Returns the world of a scene. The given vehicles, which keep their speed and heading, replace
/// the traffic of the scene.
inline World world_with(const SceneConfig& scene, const std::vector<ObjectState>& at_start,
                        int frames = 10) {
  World world = build_world(scene);
  world.trajectories = std::make_shared<const Trajectories>(straight_on(at_start, frames));
  return world;
}

inline Frame frame_of(const World& world, const LidarConfig& lidar, int k = 0) {
  FrameSimulator simulator(world, std::array{lidar});
  return std::move(simulator.simulate(k, {true}).front());
}

/// Returns a LiDAR of the catalogue.
inline LidarConfig shipped(const std::string& name, const std::string& preset = "datasheet") {
  return read_lidar(configs() / "lidars" / (name + ".yaml"), preset);
}

/// Returns a pattern with a table of five rays.
inline PatternConfig five_directions() {
  PatternConfig pattern;
  TableConfig& table = pattern.table.emplace();
  table.rays_per_s = 1003;
  table.directions = {{0, 0}, {0.1, 0.2}, {-0.3, 0.1}, {3, -0.4}, {1, 1}};
  return pattern;
}

/// Returns a spinning unit with evenly spaced channels. The lowest channel fires first, and a turn
/// begins straight ahead.
inline PatternConfig spinning(int channels, double lower_deg, double upper_deg,
                              double azimuth_step_deg) {
  SpinningConfig s;
  s.cut_angle_deg = 0;
  s.azimuth_step_deg = azimuth_step_deg;
  for (int i = 0; i < channels; ++i)
    s.channels.table.push_back(
        {.elevation_deg = lower_deg + i * (upper_deg - lower_deg) / std::max(1, channels - 1)});
  PatternConfig pattern;
  pattern.spinning = s;
  return pattern;
}

/// Returns a LiDAR that returns every hit up to 200 m, without range noise.
inline LidarConfig plain_lidar(const std::string& name, const PatternConfig& pattern) {
  LidarConfig lidar;
  lidar.name = name;
  LidarUnit unit;
  unit.pattern = pattern;
  unit.returns.max_range_m = 200;
  lidar.units.push_back(unit);
  return lidar;
}

inline Vec3 point(const PointCloud& cloud, std::size_t i) {
  return {cloud.xyz[3 * i], cloud.xyz[3 * i + 1], cloud.xyz[3 * i + 2]};
}

/// Returns the distance from a point to the surface of a box.
inline double distance_to_surface(const Box3d& box, Vec3 p) {
  const Vec2 d{p.x - box.x, p.y - box.y}, axis = heading_vector(box.heading);
  const Vec3 outside{std::abs(dot(axis, d)) - box.dx / 2, std::abs(cross(axis, d)) - box.dy / 2,
                     std::abs(p.z - box.z) - box.dz / 2};
  const double depth = std::max({outside.x, outside.y, outside.z});
  const Vec3 out{std::max(0.0, outside.x), std::max(0.0, outside.y), std::max(0.0, outside.z)};
  return depth > 0 ? norm(out) : -depth;
}

inline void expect_equal(const PointCloud& a, const PointCloud& b) {
  ASSERT_EQ(a.size(), b.size());
  PointCloud::for_each_column(
      [&](auto column, std::size_t /*values*/) { EXPECT_TRUE(a.*column == b.*column); });
}

}  // namespace infrasim::testing
