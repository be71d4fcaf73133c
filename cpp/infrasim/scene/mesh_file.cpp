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

}  // namespace

std::vector<std::string> flat_triangles(const SceneConfig& scene) {
  std::vector<std::string> lines;
  if (!scene.meshes) return lines;
  for (const MeshConfig& mesh : *scene.meshes) {
    const std::filesystem::path file = scene.folder / mesh.file;
    const PlySurface surface = read_ply(file);
    const auto flat = [&](const auto& corners) { return is_flat(surface, corners); };
    const auto count = std::ranges::count_if(surface.triangles, flat);
    if (count == 0) continue;
    const auto first = std::ranges::find_if(surface.triangles, flat);
    const Vec3& at = surface.vertices[(*first)[0]];
    lines.push_back("flat-triangles: " + file.string() + ": " + std::to_string(count) + " of " +
                    std::to_string(surface.triangles.size()) +
                    " triangles without an area, the first at x " + fixed_text(at.x, 6) + ", y " +
                    fixed_text(at.y, 6) + "; rays pass them");
  }
  return lines;
}

}  // namespace infrasim
