#include "infrasim/scene/sensor_rules.h"

#include <algorithm>
#include <array>
#include <optional>
#include <string>

#include "infrasim/config/fields.h"
#include "infrasim/config/lidar_config.h"
#include "infrasim/core/classes.h"
#include "infrasim/core/math.h"

namespace infrasim {

namespace {

using config::number_text;

/// Maximum height of a sensor above the nearest surface below it. A larger number is probably in
/// centimetres.
constexpr double kHighestPole_m = 200;
/// Maximum horizontal distance between a pole and the surface on which it stands.
constexpr double kNearPole_m = 50;

std::string metres(double z) { return number_text(std::round(z * 1000) / 1000); }

struct Sensor {
  Vec2 foot;
  double z = 0;
};

double distance(std::span<const Vec2> outline, Vec2 point) {
  if (covers(outline, point)) return 0;
  double nearest = kInf;
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const Vec2 from = outline[i], edge = outline[(i + 1) % outline.size()] - from;
    const double u = std::clamp(dot(point - from, edge) / dot(edge, edge), 0.0, 1.0);
    nearest = std::min(nearest, norm(point - (from + u * edge)));
  }
  return nearest;
}

/// Returns the distance from the line to the point; infinite if the point is beyond the line's
/// ends.
double distance_beside(const Curve& line, Vec2 point) {
  const double s = line.project(point);
  const CurvePoint p = line.at(s);
  const Vec2 away = point - p.position;
  const bool at_end = s <= 0 || s >= line.length();
  const bool beyond = at_end && std::abs(dot(away, heading_vector(p.heading))) > 1e-6;
  return beyond ? kInf : norm(away);
}

double distance_to_surfaces(const Site& site, const Sensor& sensor) {
  double nearest = kInf;
  const auto meet = [&](double beside, double z) {
    nearest = std::min(nearest, math::hypot(std::max(0.0, beside), sensor.z - z));
  };
  for (std::size_t i = 0; i < site.centrelines.size(); ++i) {
    const RoadConfig& road = site.scene.roads[i];
    const Curve& line = site.centrelines[i];
    const double from_line = norm(sensor.foot - line.at(line.project(sensor.foot)).position);
    meet(from_line - outer_half_width(road.lanes), road.elevation_m);
  }
  for (const LaneLevel& lane : lane_levels(site.lanes, sensor.foot))
    meet(lane.away - lane.half_width, lane.z);
  for (const GroundConfig& ground : site.scene.ground)
    meet(distance(ground.outline_m, sensor.foot), ground.elevation_m);
  return nearest;
}

/// Returns the height of a road's embankment or cutting at a point `beside` metres outside the
/// road's edge. Returns no value if the point is not inside the embankment or cutting.
std::optional<double> slope_over(const RoadConfig& road, double beside, double z) {
  if (!road.embankment) return std::nullopt;
  const double top = road.elevation_m, foot = road.embankment->foot_elevation_m;
  const double run = road.embankment->run_per_rise * std::abs(top - foot);
  if (beside >= run || z < std::min(top, foot)) return std::nullopt;
  const double surface = beside <= 0 ? top : top + (foot - top) * beside / run;
  return z <= surface ? std::optional(surface) : std::nullopt;
}

/// Returns the z coordinate of the surface that lies over the sensor. Returns no value if that
/// surface is a bridge. If no surface lies over the sensor and the sensor is below all surfaces of
/// the scene, returns the z coordinate of the lowest surface.
std::optional<double> ground_over(const Site& site, const Sensor& sensor) {
  double lowest = kInf, over = kInf, under = -kInf;
  const auto meet = [&](bool here, double z) {
    lowest = std::min(lowest, z);
    if (here && z < sensor.z) under = std::max(under, z);
    if (here && z >= sensor.z) over = std::min(over, z);
  };
  for (std::size_t i = 0; i < site.centrelines.size(); ++i) {
    const RoadConfig& road = site.scene.roads[i];
    const double beside =
        distance_beside(site.centrelines[i], sensor.foot) - outer_half_width(road.lanes);
    meet(beside <= 0, road.elevation_m);
    if (const auto slope = slope_over(road, beside, sensor.z)) return slope;
  }
  for (const LaneLevel& lane : lane_levels(site.lanes, sensor.foot))
    meet(!lane.beyond && lane.away <= lane.half_width, lane.z);
  for (const GroundConfig& ground : site.scene.ground)
    meet(covers(ground.outline_m, sensor.foot), ground.elevation_m);
  const bool bridge = std::isfinite(under) && over - under >= kClearance_m;
  if (std::isfinite(over) && !bridge) return over;
  return sensor.z <= lowest ? std::optional(lowest) : std::nullopt;
}

bool holds(const Box3d& box, const Sensor& sensor) {
  return BoxFrame(box).contains({sensor.foot.x, sensor.foot.y, sensor.z}, 0);
}

/// Returns the name of the object that contains the sensor; empty if there is none.
std::string what_holds(const Site& site, const Sensor& sensor) {
  for (const StaticBox& solid : site.boxes)
    if (holds(solid.box, sensor)) return solid.kind;
  for (std::size_t i = 0; i < site.barriers.size(); ++i)
    for (const Box3d& piece : site.barriers[i])
      if (holds(piece, sensor)) return "a barrier of '" + site.scene.barriers[i].road + "'";
  for (const LeafVolume& leaves : site.leaves)
    if (holds(leaves, {sensor.foot.x, sensor.foot.y, sensor.z})) return leaves.kind;
  for (const ParkedVehicle& vehicle : site.parked)
    if (holds(vehicle.state.box, sensor)) return "a parked vehicle";
  return "";
}

/// Returns the z of the lane whose vehicles would hit the sensor; no value if there is no such
/// lane. The line between two lanes belongs to neither lane.
std::optional<double> lane_around(const Site& site, const Sensor& sensor) {
  const auto in_height = [&](double z) { return sensor.z > z && sensor.z < z + kClearance_m; };
  for (const Lane& lane : site.network.lanes)
    if (in_height(lane.elevation_m) && distance_beside(lane.curve, sensor.foot) < lane.width_m / 2)
      return lane.elevation_m;
  for (const LaneLevel& lane : lane_levels(site.lanes, sensor.foot))
    if (in_height(lane.z) && !lane.beyond && lane.away < lane.half_width) return lane.z;
  return std::nullopt;
}

// maximum distance of a sensor from the walls of a building around it
constexpr double kHouse_m = 100;
constexpr std::size_t kDirections = 16;  // number of directions in which walls are searched
// minimum number of directions with a wall if the sensor is in a building; one direction may have
// an opening
constexpr std::size_t kFewestWalls = 15;

/// Surfaces of the meshes around a sensor. Heights are relative to the sensor. The height or
/// distance of a missing surface is infinite.
struct MeshesAround {
  double over = kInf;    ///< height of the lowest road, footway or terrain above the sensor
  double under = -kInf;  ///< height of the highest road, footway or terrain below the sensor
  bool on_road = false;  ///< whether the surface at `under` is a road
  bool roof = false;     ///< whether a structure is above the sensor
  /// distance of the nearest structure in each direction, at the sensor's height
  std::array<double, kDirections> walls;

  MeshesAround() { walls.fill(kInf); }
};

using Corners = std::array<Vec3, 3>;  // a triangle, relative to the sensor

/// Returns the height of a triangle above the sensor, negative below it; no value if the triangle
/// is not vertically above or below the sensor.
std::optional<double> height_over_foot(const Corners& t) {
  const double twice =
      cross(Vec2{t[1].x - t[0].x, t[1].y - t[0].y}, {t[2].x - t[0].x, t[2].y - t[0].y});
  if (twice == 0) return std::nullopt;
  double height = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec3 &a = t.at((k + 1) % 3), &b = t.at((k + 2) % 3);
    const double share = cross(Vec2{a.x, a.y}, {b.x, b.y}) / twice;
    if (share < 0) return std::nullopt;
    height += share * t.at(k).z;
  }
  return height;
}

/// Cuts a triangle at the sensor's height. In each direction that meets the cut, reduces the
/// distance of the wall to that of the cut.
void meet_walls(const Corners& t, std::array<double, kDirections>& walls) {
  std::array<Vec2, 3> cut;
  std::size_t n = 0;
  for (std::size_t k = 0; k < 3; ++k) {
    const Vec3 &a = t.at(k), &b = t.at((k + 1) % 3);
    if ((a.z < 0) == (b.z < 0)) continue;
    const double u = a.z / (a.z - b.z);
    cut.at(n++) = {a.x + u * (b.x - a.x), a.y + u * (b.y - a.y)};
  }
  if (n < 2) return;
  const Vec2 edge = cut[1] - cut[0];
  for (std::size_t i = 0; i < kDirections; ++i) {
    // Walls are often parallel to the axes. Directions turned by 0.1 rad rarely hit the corners of
    // such walls.
    const Vec2 ray = heading_vector(0.1 + 2 * kPi * static_cast<double>(i) / kDirections);
    const double side = cross(ray, cut[0]), other = cross(ray, cut[1]);
    if ((side < 0) == (other < 0)) continue;
    const double away = cross(cut[0], edge) / cross(ray, edge);
    if (away > 0) walls.at(i) = std::min(walls.at(i), away);
  }
}

MeshesAround meshes_around(const Surface& surface, Vec3 place) {
  MeshesAround around;
  for (std::size_t i = 0; i < surface.triangles.size(); ++i) {
    const auto material = static_cast<Class>(surface.class_id[i]);
    if (material > Class::kStructure) continue;
    Corners t;
    for (std::size_t k = 0; k < 3; ++k)
      t.at(k) = surface.vertices[surface.triangles[i].at(k)] - place;
    const auto height = height_over_foot(t);
    if (material == Class::kStructure) {
      around.roof |= height && *height > 0;
      meet_walls(t, around.walls);
    } else if (height && *height >= 0) {
      around.over = std::min(around.over, *height);
    } else if (height && *height > around.under) {
      around.under = *height;
      around.on_road = material == Class::kRoad;
    }
  }
  return around;
}

/// Returns whether a building encloses the sensor: a roof is above the sensor, walls are around it,
/// and no road is below it. In a tunnel or under a bridge, a road is below the sensor.
bool in_building(const MeshesAround& around) {
  const auto walls = std::ranges::count_if(around.walls, [](double m) { return m < kHouse_m; });
  return around.roof && !around.on_road && static_cast<std::size_t>(walls) >= kFewestWalls;
}

}  // namespace

double height_above_surface(const Site& site, Vec2 foot, double z) {
  double lowest = kInf, under = -kInf;
  const auto meet = [&](double surface, bool near) {
    lowest = std::min(lowest, surface);
    if (near && surface < z) under = std::max(under, surface);
  };
  for (std::size_t i = 0; i < site.centrelines.size(); ++i) {
    const Curve& line = site.centrelines[i];
    const double away = norm(foot - line.at(line.project(foot)).position);
    meet(site.scene.roads[i].elevation_m, away < kNearPole_m);
  }
  for (const LaneLevel& lane : lane_levels(site.lanes, foot)) meet(lane.z, lane.away < kNearPole_m);
  for (const GroundConfig& ground : site.scene.ground)
    meet(ground.elevation_m, distance(ground.outline_m, foot) < kNearPole_m);
  return z - (std::isfinite(under) ? under : lowest);
}

void check_sensor_at(const Site& site, const std::string& name, const MountConfig& mount) {
  // The rules use the heights of the scene file, before the profile raises the scene.
  const double rise = site.profile.rise({mount.x_m, mount.y_m});
  const Sensor sensor{{mount.x_m, mount.y_m}, mount.z_m - rise};
  const auto fail = [&](const char* key, const std::string& what) {
    config::fail(mount.place, "mounts." + name + "." + key, what);
  };
  const std::string got = ", got " + number_text(mount.z_m);
  if (const double away = distance_to_surfaces(site, sensor); away > kLongestRange_m)
    fail("x_m", "expected a position up to " + number_text(kLongestRange_m) +
                    " m (the longest range of a ray) from a road or the ground, got " +
                    number_text(std::round(away)) + " m from every road and ground");
  const double height = height_above_surface(site, sensor.foot, sensor.z);
  if (std::isfinite(height) && height > kHighestPole_m)
    fail("z_m", "expected metres, up to " + number_text(kHighestPole_m) +
                    " m above the roads and the ground" + got + "; " + number_text(mount.z_m) +
                    " centimetres are " + number_text(mount.z_m / 100) + " m");
  if (const auto over = ground_over(site, sensor))
    fail("z_m", "expected a mount above the surface, or below a bridge with a clearance of " +
                    number_text(kClearance_m) + " m" + got + " below the ground or a road at " +
                    metres(*over + rise) + " m");
  if (const std::string what = what_holds(site, sensor); !what.empty())
    fail("x_m", "expected a position outside objects, got one inside " + what);
  if (const auto lane = lane_around(site, sensor))
    fail("z_m", "expected " + metres(*lane + rise + kClearance_m) +
                    " or more, or a position beside the lanes" + got +
                    ", where vehicles hit the LiDAR, above a lane at z_m " + metres(*lane + rise));
}

void check_sensor_in_meshes(const Site& site, const std::string& name, const MountConfig& mount,
                            const Surface& surface) {
  if (!site.scene.meshes) return;
  const MeshesAround around = meshes_around(surface, {mount.x_m, mount.y_m, mount.z_m});
  if (in_building(around))
    config::fail(mount.place, "mounts." + name + ".x_m",
                 "expected a position outside buildings, got one inside a structure of the meshes, "
                 "below a roof and between walls " +
                     metres(std::ranges::min(around.walls)) + " m away or more");
  const bool bridge = std::isfinite(around.under) && around.over - around.under >= kClearance_m;
  if (!std::isfinite(around.over) || bridge) return;
  config::fail(mount.place, "mounts." + name + ".z_m",
               "expected a mount above the surface, or below a bridge with a clearance of " +
                   number_text(kClearance_m) + " m, got " + number_text(mount.z_m) +
                   " below a surface of the meshes at " + metres(mount.z_m + around.over) + " m");
}

void check_sensor_is_free(const SceneConfig& scene, const std::vector<ObjectState>& states,
                          int instant) {
  for (const auto& [name, mount] : scene.mounts)
    for (const ObjectState& s : states)
      if (norm(Vec2{s.box.x - mount.x_m, s.box.y - mount.y_m}) <= s.box.dx + s.box.dy + s.box.dz &&
          holds(s.box, {{mount.x_m, mount.y_m}, mount.z_m}))
        config::fail(mount.place, "mounts." + name + ".x_m",
                     "expected a position outside the paths of vehicles, got one inside vehicle " +
                         std::to_string(s.id) + " at " + number_text(instant / 10.0) + " s");
}

}  // namespace infrasim
