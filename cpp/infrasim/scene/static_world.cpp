#include "infrasim/scene/static_world.h"

#include <algorithm>

#include "infrasim/core/classes.h"
#include "infrasim/io/ply_file.h"
#include "infrasim/scene/lane_network.h"
#include "infrasim/scene/profile.h"
#include "infrasim/scene/vegetation.h"

namespace infrasim {

namespace {

constexpr double kLegWidth = 0.4;    // m, of a gantry
constexpr double kBeamHeight = 1.0;  // m, of a gantry
constexpr double kKerbRun = 0.15;    // m, from the foot of a roundabout's island to its top
constexpr double kLegGap = 0.5;      // m between the carriageway and a gantry's leg

class MeshBuilder {
 public:
  void quad(Vec3 a, Vec3 b, Vec3 c, Vec3 d, Class material) {
    const auto first = next();
    surface_.vertices.insert(surface_.vertices.end(), {a, b, c, d});
    triangle(first, first + 1, first + 2, material);
    triangle(first, first + 2, first + 3, material);
  }

  /// Surface between two lines parallel to a curve, each with its own height.
  void strip(const Curve& curve, double left_a, double z_a, double left_b, double z_b,
             Class material) {
    const Curve a = curve.offset(left_a), b = curve.offset(left_b);
    for (std::size_t i = 0; i + 1 < curve.samples().size(); ++i) {
      const Vec2 a0 = a.samples()[i].position, a1 = a.samples()[i + 1].position;
      const Vec2 b0 = b.samples()[i].position, b1 = b.samples()[i + 1].position;
      quad({a0.x, a0.y, z_a}, {a1.x, a1.y, z_a}, {b1.x, b1.y, z_b}, {b0.x, b0.y, z_b}, material);
    }
  }

  void fan(const std::vector<Vec2>& outline, double z, Class material) {
    const auto first = next();
    for (const Vec2& p : outline) surface_.vertices.push_back({p.x, p.y, z});
    for (std::uint32_t i = 1; i + 1 < outline.size(); ++i)
      triangle(first, first + i, first + i + 1, material);
  }

  void box(const Box3d& box, Class material) {
    const auto corners = footprint(box);
    const double low = box.z - box.dz / 2, high = box.z + box.dz / 2;
    const auto at = [&](std::size_t i, double z) { return Vec3{corners[i].x, corners[i].y, z}; };
    for (std::size_t i = 0; i < 4; ++i)
      quad(at(i, low), at((i + 1) % 4, low), at((i + 1) % 4, high), at(i, high), material);
    quad(at(0, high), at(1, high), at(2, high), at(3, high), material);
    quad(at(0, low), at(1, low), at(2, low), at(3, low), material);
  }

  void surface(const PlySurface& surface, Class material) {
    const auto first = next();
    auto& vertices = surface_.vertices;
    vertices.insert(vertices.end(), surface.vertices.begin(), surface.vertices.end());
    for (const auto& t : surface.triangles)
      triangle(first + t[0], first + t[1], first + t[2], material);
  }

  /// All of it, lifted by the profile, in the levelled frame.
  TriangleMesh take(const Profile& profile, const LevelPose& level) {
    profile.lift(surface_);
    TriangleMesh mesh{{}, std::move(surface_.triangles), std::move(surface_.class_id)};
    mesh.vertices.reserve(surface_.vertices.size());
    for (const Vec3& world : surface_.vertices) {
      const Vec3 p = level.to_level(world);
      mesh.vertices.push_back(
          {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)});
    }
    return mesh;
  }

 private:
  std::uint32_t next() const { return static_cast<std::uint32_t>(surface_.vertices.size()); }
  void triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c, Class material) {
    surface_.triangles.push_back({a, b, c});
    surface_.class_id.push_back(static_cast<std::uint16_t>(material));
  }

  Surface surface_;
};

const RoadConfig& road_named(const SceneConfig& scene, const std::string& name,
                             const config::Place& place) {
  return scene.roads[road_index(scene, name, place, "road")];
}

void add_road(MeshBuilder& mesh, const RoadConfig& road) {
  const Curve curve = centreline(road);
  const double z = road.elevation_m;
  const double edge = carriageway_half_width(road.lanes), outer = outer_half_width(road.lanes);
  mesh.strip(curve, edge, z, -edge, z, Class::kRoad);
  for (const double side : {1.0, -1.0}) {
    if (road.lanes.sidewalk_m > 0)
      mesh.strip(curve, side * edge, z - kSidewalkDrop, side * outer, z - kSidewalkDrop,
                 Class::kSidewalk);
    if (!road.embankment) continue;
    const double foot = road.embankment->foot_elevation_m;
    const double run = road.embankment->run_per_rise * std::abs(z - foot);
    mesh.strip(curve, side * outer, z, side * (outer + run), foot, Class::kTerrain);
  }
}

void add_ring(MeshBuilder& mesh, const Ring& ring) {
  const Curve line = ring.line({});
  const double z = ring.elevation_m, top = z + ring.config.island_m;
  const double inner = ring.config.width_m / 2, kerb = inner + kKerbRun;
  mesh.strip(line, inner, z, -inner - kRingShoulder_m, z, Class::kRoad);
  mesh.strip(line, inner, z, kerb, top, Class::kTerrain);
  std::vector<Vec2> island;
  const Curve edge = line.offset(kerb);
  for (const CurvePoint& p : edge.samples()) island.push_back(p.position);
  mesh.fan(island, top, Class::kTerrain);
}

void add_barrier(MeshBuilder& mesh, const SceneConfig& scene, const BarrierConfig& barrier) {
  const RoadConfig& road = road_named(scene, barrier.road, barrier.place);
  const Curve full = centreline(road);
  const Curve curve = full.part(barrier.from_m, std::min(barrier.to_m, full.length()));
  const double low = road.elevation_m, high = low + barrier.height_m;
  const double left = barrier.offset_m + barrier.width_m / 2, right = left - barrier.width_m;
  mesh.strip(curve, left, low, left, high, Class::kStructure);
  mesh.strip(curve, right, low, right, high, Class::kStructure);
  mesh.strip(curve, left, high, right, high, Class::kStructure);
}

}  // namespace

Vec3 LevelPose::to_level(Vec3 world) const {
  const Vec3 d = world - origin;
  const double c = std::cos(yaw), s = std::sin(yaw);
  return {c * d.x + s * d.y, -s * d.x + c * d.y, d.z};
}

Box3d LevelPose::to_level(const Box3d& world) const {
  const Vec3 p = to_level(Vec3{world.x, world.y, world.z});
  return {p.x,        p.y, p.z, world.dx, world.dy, world.dz, wrap_angle(world.heading - yaw),
          world.pitch};
}

LevelPose level_pose(const MountConfig& mount) {
  return {{mount.x_m, mount.y_m, mount.z_m}, rad(mount.yaw_deg)};
}

std::vector<Upright> uprights(const SceneConfig& scene) {
  std::vector<Upright> out;
  for (const BuildingConfig& b : scene.buildings)
    out.push_back({{b.x_m, b.y_m, b.base_m + b.height_m / 2, b.length_m, b.width_m, b.height_m,
                    rad(b.heading_deg)},
                   b.place,
                   "x_m",
                   "a building"});
  for (const GantryConfig& g : scene.gantries) {
    const RoadConfig& road = road_named(scene, g.road, g.place);
    const Curve curve = centreline(road);
    if (g.s_m > curve.length())
      config::fail(g.place, "s_m", "found it beyond the road's end, allowed up to it");
    const CurvePoint foot = curve.at(g.s_m);
    const double leg = carriageway_half_width(road.lanes) + kLegGap;
    const double z = road.elevation_m;
    const auto add = [&](double left, double base, double width, double height) {
      const Vec2 p = foot.position + left * heading_vector(foot.heading + kPi / 2);
      out.push_back({{p.x, p.y, base + height / 2, kLegWidth, width, height, foot.heading},
                     g.place,
                     "s_m",
                     "a gantry"});
    };
    for (const double side : {leg, -leg}) add(side, z, kLegWidth, g.clearance_m);
    add(0, z + g.clearance_m, 2 * leg + kLegWidth, kBeamHeight);
  }
  const std::vector<Upright> trees = trunks(scene);
  out.insert(out.end(), trees.begin(), trees.end());
  return out;
}

std::vector<Box3d> barrier_pieces(const SceneConfig& scene, const BarrierConfig& barrier,
                                  double longest_m) {
  const RoadConfig& road = road_named(scene, barrier.road, barrier.place);
  const Curve line = centreline(road);
  const double to = std::min(barrier.to_m, line.length());
  if (barrier.from_m >= to)
    config::fail(barrier.place, "from_m", "found it beyond to_m or the road's end, allowed before");
  std::vector<Box3d> out;
  for (double s = barrier.from_m; s < to; s += longest_m) {
    const double length = std::min(longest_m, to - s);
    const CurvePoint p = line.at(s + length / 2);
    const Vec2 centre = p.position + barrier.offset_m * heading_vector(p.heading + kPi / 2);
    out.push_back({centre.x, centre.y, road.elevation_m + barrier.height_m / 2, length,
                   barrier.width_m, barrier.height_m, p.heading});
  }
  return out;
}

TriangleMesh build_static_mesh(const SceneConfig& scene, const LevelPose& level) {
  MeshBuilder mesh;
  for (const RoadConfig& road : scene.roads) add_road(mesh, road);
  for (const Ring& ring : rings_of(scene)) add_ring(mesh, ring);
  for (const GroundConfig& ground : scene.ground)
    mesh.fan(ground.outline_m, ground.elevation_m, Class::kTerrain);
  for (const BarrierConfig& barrier : scene.barriers) add_barrier(mesh, scene, barrier);
  if (scene.meshes)
    for (const MeshConfig& row : *scene.meshes)
      mesh.surface(read_ply(scene.folder / row.file), static_cast<Class>(row.material));
  for (const Upright& upright : uprights(scene)) mesh.box(upright.box, Class::kStructure);
  return mesh.take(Profile(scene), level);
}

}  // namespace infrasim
