#include "infrasim/scene/solids.h"

#include <algorithm>
#include <initializer_list>

#include "infrasim/core/math.h"

namespace infrasim {

std::uint32_t add_vertex(TriangleMesh& mesh, Vec3 p) {
  mesh.vertices.push_back(
      {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)});
  return static_cast<std::uint32_t>(mesh.vertices.size() - 1);
}

void join(TriangleMesh& mesh, std::uint32_t a, std::uint32_t b, std::uint32_t n) {
  for (std::uint32_t i = 0; i < n; ++i) {
    const std::uint32_t j = (i + 1) % n;
    mesh.triangles.push_back({a + i, b + i, b + j});
    mesh.triangles.push_back({a + i, b + j, a + j});
  }
}

void add_ellipsoid(TriangleMesh& mesh, const Ellipsoid& e, int bands, int sectors) {
  // `tall` is the area of a polygon that is inscribed in a half circle, divided by the area of the
  // half circle. `round` is the mean width of a polygon that is inscribed in a circle, divided by
  // the diameter of the circle.
  const double tall = bands * math::sin(kPi / bands) / kPi;
  const double round = sectors * math::sin(kPi / sectors) / kPi;
  const double wide = 1 / (tall * round);
  const auto n = static_cast<std::uint32_t>(sectors);
  const auto place = [&](double latitude, double angle) {
    const double r = wide * math::cos(latitude), up = math::sin(latitude);
    return e.centre + Vec3{e.radii.x * r * math::cos(angle) + e.lean * up,
                           e.radii.y * r * math::sin(angle), e.radii.z * up};
  };
  const std::uint32_t bottom = add_vertex(mesh, place(-kPi / 2, 0));
  for (int band = 1; band < bands; ++band)
    for (int k = 0; k < sectors; ++k)
      add_vertex(mesh, place(kPi * band / bands - kPi / 2, 2 * kPi * k / sectors));
  const std::uint32_t top = add_vertex(mesh, place(kPi / 2, 0));
  for (std::uint32_t i = 0; i < n; ++i) {
    const std::uint32_t j = (i + 1) % n;
    mesh.triangles.push_back({bottom, bottom + 1 + i, bottom + 1 + j});
    mesh.triangles.push_back({top, top - n + j, top - n + i});
  }
  for (std::uint32_t first = bottom + 1; first + n < top; first += n)
    join(mesh, first, first + n, n);
}

void add_ring(TriangleMesh& mesh, Vec3 centre, double radius, double depth, double width,
              int segments) {
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  for (int k = 0; k < segments; ++k) {
    const double angle = 2 * kPi * (k + 0.5) / segments;
    const Vec3 out{math::cos(angle), 0, -math::sin(angle)};
    add_vertex(mesh, centre + radius * out);
    for (const double side : {-1.0, 1.0})
      add_vertex(mesh, centre + (radius - depth) * out + Vec3{0, side * width / 2, 0});
  }
  const auto n = static_cast<std::uint32_t>(segments);
  for (std::uint32_t k = 0; k < n; ++k) join(mesh, first + 3 * k, first + 3 * ((k + 1) % n), 3);
}

void add_bar(TriangleMesh& mesh, Vec3 from, Vec3 to, double radius, int sides) {
  const Vec3 along = to - from;
  const Vec3 aside = cross(Vec3{0, 0, 1}, along), up = cross(along, aside);
  const auto n = static_cast<std::uint32_t>(sides);
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  for (const Vec3 end : {from, to})
    for (int k = 0; k < sides; ++k) {
      const double angle = 2 * kPi * k / sides;
      add_vertex(mesh, end + (radius * math::cos(angle) / norm(up)) * up +
                           (radius * math::sin(angle) / norm(aside)) * aside);
    }
  join(mesh, first + n, first, n);
  for (std::uint32_t i = 1; i + 1 < n; ++i) {
    mesh.triangles.push_back({first, first + i + 1, first + i});
    mesh.triangles.push_back({first + n, first + n + i, first + n + i + 1});
  }
}

TriangleMesh in_unit_box(TriangleMesh mesh) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto at = [axis](const std::array<float, 3>& v) { return v.at(axis); };
    const auto [low, high] = std::ranges::minmax(mesh.vertices, {}, at);
    const double from = low.at(axis), size = high.at(axis) - from;
    for (auto& v : mesh.vertices)
      v.at(axis) = std::clamp(static_cast<float>((v.at(axis) - from) / size - 0.5), -0.5F, 0.5F);
  }
  return mesh;
}

}  // namespace infrasim
