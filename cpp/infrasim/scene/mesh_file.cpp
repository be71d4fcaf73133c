#include "infrasim/scene/mesh_file.h"

#include <algorithm>

#include "infrasim/core/numbers.h"
#include "infrasim/io/ply_file.h"

namespace infrasim {

namespace {

constexpr double kLeastArea_m2 = 1e-9;

bool is_flat(const PlySurface& surface, const std::array<std::uint32_t, 3>& corners) {
  const Vec3 &a = surface.vertices[corners[0]], &b = surface.vertices[corners[1]],
             &c = surface.vertices[corners[2]];
  return norm(cross(b - a, c - a)) / 2 < kLeastArea_m2;
}

// A surface is suspicious if it is more than this number of times as wide as its site's roads.
// Terrain around a site is up to about ten times as wide.
constexpr double kMostRoads = 20;
constexpr double kLeastRoads_m = 250;  // minimum extent of roads in the comparison with a surface
constexpr double kMostRelief_m = 1000;
constexpr double kTallest_m = 300;  // maximum height of surfaces that are taller than wide

/// Returns the larger side of the rectangle around all roads and lanes.
double size_of_roads(const Site& site) {
  Vec2 low{kInf, kInf}, high{-kInf, -kInf};
  const auto take = [&](const Curve& line) {
    for (const CurvePoint& p : line.samples()) {
      low = {std::min(low.x, p.position.x), std::min(low.y, p.position.y)};
      high = {std::max(high.x, p.position.x), std::max(high.y, p.position.y)};
    }
  };
  for (const Curve& line : site.centrelines) take(line);
  for (const LanePath& lane : site.lanes) take(lane.line);
  return std::max({0.0, high.x - low.x, high.y - low.y});
}

}  // namespace

std::vector<std::string> flat_triangles(const SceneConfig& scene) {
  std::vector<std::string> lines;
  if (!scene.meshes) return lines;
  for (const MeshConfig& mesh : *scene.meshes) {
    const std::filesystem::path file = scene.folder / mesh.file;
    const PlySurface surface = config::read_named(mesh.file_key, [&] { return read_ply(file); });
    const auto flat = [&](const auto& corners) { return is_flat(surface, corners); };
    const auto count = std::ranges::count_if(surface.triangles, flat);
    if (count == 0) continue;
    const auto first = std::ranges::find_if(surface.triangles, flat);
    const Vec3& at = surface.vertices[(*first)[0]];
    lines.push_back("flat-triangles: " + file.string() + ": " + std::to_string(count) + " of " +
                    std::to_string(surface.triangles.size()) +
                    " triangles without an area, the first at x " + fixed_text(at.x, 6) + ", y " +
                    fixed_text(at.y, 6) + "; rays pass through them");
  }
  return lines;
}

std::vector<std::string> unit_warnings(const Site& site, const Surface& surface) {
  std::vector<std::string> lines;
  if (!site.scene.meshes) return lines;
  const double roads = size_of_roads(site);
  for (std::size_t i = 0; i < surface.mesh_bounds.size(); ++i) {
    const auto& [low, high] = surface.mesh_bounds[i];
    const double wide = std::max(high.x - low.x, high.y - low.y), tall = high.z - low.z;
    const bool is_pole = tall > kTallest_m && tall > wide;
    if (wide <= kMostRoads * std::max(roads, kLeastRoads_m) && tall <= kMostRelief_m && !is_pole)
      continue;
    const auto m = [](double value) { return fixed_text(value, 0); };
    lines.push_back("mesh-units: " + (site.scene.folder / (*site.scene.meshes)[i].file).string() +
                    ": expected metres, got a surface of " + m(high.x - low.x) + " x " +
                    m(high.y - low.y) + " x " + m(tall) + " beside roads of " + m(roads) +
                    " m, which is probably in centimetres or millimetres");
  }
  return lines;
}

}  // namespace infrasim
