#include "infrasim/scene/static_world.h"

#include <algorithm>

#include "infrasim/core/classes.h"
#include "infrasim/core/math.h"
#include "infrasim/io/ply_file.h"

namespace infrasim {

namespace {

constexpr double kKerbRun = 0.15;  // m, width of the kerb around a roundabout's island

class MeshBuilder {
 public:
  void quad(Vec3 a, Vec3 b, Vec3 c, Vec3 d, Class material) {
    const auto first = next();
    surface_.vertices.insert(surface_.vertices.end(), {a, b, c, d});
    triangle(first, first + 1, first + 2, material);
    triangle(first, first + 2, first + 3, material);
  }

  /// Adds a surface between two lines parallel to a curve, each with its own height.
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
    Vec3 low{kInf, kInf, kInf}, high{-kInf, -kInf, -kInf};
    for (const Vec3& v : surface.vertices) {
      low = {std::min(low.x, v.x), std::min(low.y, v.y), std::min(low.z, v.z)};
      high = {std::max(high.x, v.x), std::max(high.y, v.y), std::max(high.z, v.z)};
    }
    surface_.mesh_bounds.push_back({low, high});
  }

  /// Returns the whole surface, raised by the profile.
  Surface take(const Profile& profile) {
    profile.lift(surface_);
    return std::move(surface_);
  }

 private:
  std::uint32_t next() const { return static_cast<std::uint32_t>(surface_.vertices.size()); }
  void triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c, Class material) {
    surface_.triangles.push_back({a, b, c});
    surface_.class_id.push_back(static_cast<std::uint16_t>(material));
  }

  Surface surface_;
};

void add_road(MeshBuilder& mesh, const RoadConfig& road, const Curve& curve) {
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

void add_barrier(MeshBuilder& mesh, const Site& site, const BarrierConfig& barrier) {
  const auto [road, full] = road_named(site.scene, site.centrelines, barrier.road, barrier.place);
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
  const double c = math::cos(yaw), s = math::sin(yaw);
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

Surface build_static_surface(const Site& site) {
  const SceneConfig& scene = site.scene;
  MeshBuilder mesh;
  for (std::size_t i = 0; i < scene.roads.size(); ++i)
    add_road(mesh, scene.roads[i], site.centrelines[i]);
  for (const std::optional<Ring>& ring : site.network.rings)
    if (ring) add_ring(mesh, *ring);
  for (const GroundConfig& ground : scene.ground)
    mesh.fan(ground.outline_m, ground.elevation_m, Class::kTerrain);
  for (const BarrierConfig& barrier : scene.barriers) add_barrier(mesh, site, barrier);
  if (scene.meshes)
    for (const MeshConfig& row : *scene.meshes)
      mesh.surface(
          config::read_named(row.file_key, [&] { return read_ply(scene.folder / row.file); }),
          static_cast<Class>(row.material));
  for (const StaticBox& solid : site.boxes) mesh.box(solid.box, Class::kStructure);
  return mesh.take(site.profile);
}

TriangleMesh to_level(const Surface& surface, const LevelPose& level) {
  TriangleMesh mesh{{}, surface.triangles, surface.class_id};
  mesh.vertices.reserve(surface.vertices.size());
  for (const Vec3& world : surface.vertices) {
    const Vec3 p = level.to_level(world);
    mesh.vertices.push_back(
        {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)});
  }
  return mesh;
}

}  // namespace infrasim
