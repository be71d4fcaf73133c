#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "infrasim/core/geometry.h"
#include "infrasim/core/rng.h"

namespace infrasim::testing {

/// A road along x whose cross-section is a polyline of (y, z), with boxes on it, in the levelled
/// LiDAR frame. `grade` is the slope dz/dx of the road.
struct Scene {
  std::vector<Vec2> profile;
  double grade = 0;
  std::vector<Box3d> vehicles;
  std::vector<Box3d> buildings;
};

/// Points, and the object to which each point belongs.
struct LabelledCloud {
  std::vector<float> xyz;
  std::vector<int> object;           ///< index into vehicles; -1 ground, -2 building
  std::vector<double> above_road_m;  ///< height above the road
  std::size_t size() const { return object.size(); }
};

inline double range_to_profile(const Scene& scene, Vec3 u) {
  double nearest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i + 1 < scene.profile.size(); ++i) {
    const auto [y0, z0] = scene.profile[i];
    const auto [y1, z1] = scene.profile[i + 1];
    const double slope = (z1 - z0) / (y1 - y0);
    // range at which the ray meets the plane z = z0 + slope (y - y0) + grade x
    const double range = (z0 - slope * y0) / (u.z - slope * u.y - scene.grade * u.x);
    const double y = range * u.y;
    if (range > 0 && y >= y0 && y < y1) nearest = std::min(nearest, range);
  }
  return nearest;
}

inline double range_to_box(const Box3d& box, Vec3 u) {
  const Vec2 axis = heading_vector(box.heading);
  const Vec2 centre{box.x, box.y};
  const double origin[] = {-dot(axis, centre), -cross(axis, centre), -box.z};
  const double step[] = {dot(axis, Vec2{u.x, u.y}), cross(axis, Vec2{u.x, u.y}), u.z};
  const double half[] = {box.dx / 2, box.dy / 2, box.dz / 2};
  double enter = 0, leave = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 3; ++i) {
    const double a = (-half[i] - origin[i]) / step[i];
    const double b = (half[i] - origin[i]) / step[i];
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  return enter <= leave ? enter : std::numeric_limits<double>::infinity();
}

/// Returns the nearest hit along each unit direction within `max_range_m`, with 2 cm of range
/// noise.
inline LabelledCloud cast(const Scene& scene, std::span<const Vec3> directions, std::int64_t frame,
                          double max_range_m = 120) {
  LabelledCloud cloud;
  const Rng rng = Rng::of(1, "filter_scenes").at(static_cast<std::uint64_t>(frame));
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const Vec3 u = directions[i];
    double range = range_to_profile(scene, u);
    int object = -1;
    const auto meet = [&](const Box3d& box, int id) {
      const double r = range_to_box(box, u);
      if (r < range) range = r, object = id;
    };
    for (std::size_t k = 0; k < scene.vehicles.size(); ++k)
      meet(scene.vehicles[k], static_cast<int>(k));
    for (const Box3d& box : scene.buildings) meet(box, -2);
    if (range > max_range_m) continue;
    const Vec3 p = (range + 0.02 * rng.at(i).normal(0)) * u;
    for (const double v : {p.x, p.y, p.z}) cloud.xyz.push_back(static_cast<float>(v));
    cloud.object.push_back(object);
    cloud.above_road_m.push_back(p.z - scene.grade * p.x + 6);
  }
  return cloud;
}

inline Vec3 direction(double azimuth, double elevation) {
  return {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
          std::sin(elevation)};
}

/// Returns the directions of a LiDAR with 128 evenly spaced lines from -25 to 15 degrees, with
/// azimuth steps of 0.2 degrees.
inline std::vector<Vec3> spinning_directions() {
  std::vector<Vec3> out;
  for (int a = 0; a < 1800; ++a)
    for (int ring = 0; ring < 128; ++ring)
      out.push_back(direction(rad(0.2 * a - 180), rad(-25 + ring * 40.0 / 127)));
  return out;
}

/// Returns the directions of one frame of a rosette pattern, which covers 70 x 70 degrees and never
/// repeats. The pattern has 24,000 rays per frame and looks 15 degrees down.
inline std::vector<Vec3> rosette_directions(std::int64_t frame) {
  std::vector<Vec3> out;
  for (int i = 0; i < 24000; ++i) {
    const double t = (static_cast<double>(frame) + i / 24000.0) * 0.1;
    const double a = 2 * kPi * 121.57 * t, b = -2 * kPi * 77.3 * t;
    const double radius = rad(17.5);
    out.push_back(direction(radius * (std::cos(a) + std::cos(b)),
                            rad(-15) + radius * (std::sin(a) + std::sin(b))));
  }
  return out;
}

/// Returns vehicles of several sizes in lanes centred at `lanes_y`. The vehicles of a lane are
/// `spacing_m` apart and shifted by `shift_m`.
inline std::vector<Box3d> traffic(std::span<const double> lanes_y, double spacing_m, double shift_m,
                                  double grade = 0) {
  const double sizes[][3] = {{4.5, 1.8, 1.5}, {12, 2.5, 3.8},  {4.2, 1.7, 1.4}, {2.2, 0.8, 1.5},
                             {5.4, 2.0, 2.3}, {4.8, 1.9, 1.6}, {11, 2.55, 3.2}, {4.0, 1.7, 1.5}};
  std::vector<Box3d> out;
  std::uint64_t serial = 0;
  for (const double y : lanes_y) {
    const double way = y < 0 ? 1 : -1;
    for (double s = -240; s < 240; s += spacing_m, ++serial) {
      const Rng rng = Rng::of(2, "traffic").at(serial);
      const auto& size = sizes[rng.bits(0) % 8];
      const double x = std::remainder(s + 8 * rng.uniform(1) + way * shift_m, 480.0);
      if (std::abs(x) > 118) continue;
      out.push_back({x, y + 0.4 * (rng.uniform(2) - 0.5), -6 + size[2] / 2 + grade * x, size[0],
                     size[1], size[2], (way > 0 ? 0 : kPi) + 0.1 * (rng.uniform(3) - 0.5)});
    }
  }
  return out;
}

}  // namespace infrasim::testing
