#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>
#include <string>
#include <utility>

#include "infrasim/core/classes.h"
#include "infrasim/core/geometry.h"
#include "infrasim/scene/vehicle_body.h"

namespace infrasim {
namespace {

bool is_person(const ObjectClass& row) { return !row.vehicle; }

/// Calls check(mesh, detail, class) for each class at each level of detail.
template <class Check>
void for_each_body(const Check& check) {
  for (const ObjectClass& row : kObjectClasses)
    for (const Detail detail : {Detail::kBox, Detail::kLow, Detail::kMid, Detail::kFine}) {
      SCOPED_TRACE(std::string(row.name) + " " +
                   enum_names(detail)[static_cast<std::size_t>(detail)]);
      check(build_vehicle_body(row.id, detail), detail, row);
    }
}

TEST(vehicle_body, stands_a_millimetre_above_the_bottom_of_its_vehicles_box_and_inside_of_it) {
  const Box3d box{10, 20, 3, 4.5, 1.9, 1.5, 0.3}, body = body_box(box);
  EXPECT_NEAR(body.z - body.dz / 2, box.z - box.dz / 2 + 0.001, 1e-12);
  EXPECT_NEAR(body.z + body.dz / 2, box.z + box.dz / 2, 1e-12);
  EXPECT_NEAR(body.dx, box.dx - 0.001, 1e-12);
  EXPECT_NEAR(body.dy, box.dy - 0.001, 1e-12);
  EXPECT_TRUE(body.x == box.x && body.y == box.y && body.heading == box.heading);
}

TEST(vehicle_body, fills_its_box_and_touches_all_six_faces) {
  for_each_body([](const TriangleMesh& mesh, Detail, const ObjectClass&) {
    std::array<float, 3> low{1, 1, 1}, high{-1, -1, -1};
    for (const auto& v : mesh.vertices)
      for (std::size_t axis = 0; axis < 3; ++axis) {
        low.at(axis) = std::min(low.at(axis), v.at(axis));
        high.at(axis) = std::max(high.at(axis), v.at(axis));
      }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(low.at(axis), -0.5, 1e-6) << "axis " << axis;
      EXPECT_NEAR(high.at(axis), 0.5, 1e-6) << "axis " << axis;
      EXPECT_GE(low.at(axis), -0.5) << "axis " << axis;
      EXPECT_LE(high.at(axis), 0.5) << "axis " << axis;
    }
  });
}

TEST(vehicle_body, is_closed) {
  for_each_body([](const TriangleMesh& mesh, Detail, const ObjectClass&) {
    // Each edge of a triangle has a direction. The neighbouring triangle has the same edge in the
    // opposite direction.
    std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
    for (const auto& t : mesh.triangles)
      for (std::size_t i = 0; i < 3; ++i) ++edges[{t.at(i), t.at((i + 1) % 3)}];
    for (const auto& [edge, count] : edges) {
      EXPECT_EQ(count, 1);
      EXPECT_EQ(edges.count({edge.second, edge.first}), 1U);
    }
  });
}

/// Returns the volume as a share of the box's volume, by the divergence theorem. Triangles are
/// clockwise seen from outside.
double volume(const TriangleMesh& mesh) {
  double sum = 0;
  for (const auto& t : mesh.triangles) {
    const auto vertex = [&](std::size_t i) {
      const auto& v = mesh.vertices.at(t.at(i));
      return Vec3{v[0], v[1], v[2]};
    };
    sum -= dot(vertex(0), cross(vertex(1), vertex(2))) / 6;
  }
  return sum;
}

TEST(vehicle_body, takes_up_a_good_part_of_its_box) {
  for_each_body([](const TriangleMesh& mesh, Detail detail, const ObjectClass& row) {
    const bool figure = is_person(row) && detail != Detail::kBox;
    EXPECT_GT(volume(mesh), figure ? 0.03 : 0.25);
    EXPECT_LE(volume(mesh), figure ? 0.12 : 1.000001);
  });
}

TEST(vehicle_body, of_a_person_displaces_as_much_as_one_of_50_to_100_kg) {
  for_each_body([](const TriangleMesh& mesh, Detail detail, const ObjectClass& row) {
    if (!is_person(row) || detail == Detail::kBox) return;
    const double litres =
        1000 * volume(mesh) * row.length_m.mean * row.width_m.mean * row.height_m.mean;
    EXPECT_GT(litres, 50);
    EXPECT_LT(litres, 100);
  });
}

/// Returns the share of the rays of a grid, parallel to an axis (0: x, 1: y), that meet the body.
double silhouette(const TriangleMesh& mesh, std::size_t axis) {
  constexpr int kGrid = 60;
  int stopped = 0;
  for (int i = 0; i < kGrid * kGrid; ++i) {
    const int column = i % kGrid, row = i / kGrid;
    const Vec2 p{(column + 0.5) / kGrid - 0.5, (row + 0.5) / kGrid - 0.5};
    stopped += std::ranges::any_of(mesh.triangles, [&](const auto& t) {
      const auto corner = [&](std::size_t k) {
        const auto& v = mesh.vertices.at(t.at(k));
        return Vec2{v.at(1 - axis), v[2]} - p;
      };
      const Vec2 a = corner(0), b = corner(1), c = corner(2);
      const double u = cross(a, b), v = cross(b, c), w = cross(c, a);
      return (u > 0 && v > 0 && w > 0) || (u < 0 && v < 0 && w < 0);
    });
  }
  return static_cast<double>(stopped) / (kGrid * kGrid);
}

TEST(vehicle_body, of_a_person_hides_as_much_at_each_level_of_detail) {
  for (const Class person : {Class::kPedestrian, Class::kCyclist})
    for (const std::size_t axis : {0U, 1U}) {
      const double fine = silhouette(build_vehicle_body(person, Detail::kFine), axis);
      for (const Detail detail : {Detail::kLow, Detail::kMid})
        EXPECT_NEAR(silhouette(build_vehicle_body(person, detail), axis) / fine, 1, 0.12)
            << class_of(person).name << " along axis " << axis << " at "
            << enum_names(detail)[static_cast<std::size_t>(detail)];
      EXPECT_LT(fine, 0.6);
    }
}

bool has_vertex(const TriangleMesh& mesh, const std::array<float, 3>& wanted) {
  return std::ranges::any_of(mesh.vertices, [&](const auto& v) {
    return std::abs(v[0] - wanted[0]) + std::abs(v[1] - wanted[1]) + std::abs(v[2] - wanted[2]) <
           2e-6F;
  });
}

TEST(vehicle_body, is_the_same_on_its_left_and_right_but_for_a_stride) {
  for_each_body([](const TriangleMesh& mesh, Detail detail, const ObjectClass& row) {
    const bool stride = row.id == Class::kPedestrian && detail != Detail::kBox;
    bool mirrored = true;
    for (const auto& v : mesh.vertices) {
      mirrored = mirrored && has_vertex(mesh, {v[0], -v[1], v[2]});
      EXPECT_TRUE(!stride || has_vertex(mesh, {-v[0], -v[1], v[2]}));
    }
    EXPECT_EQ(mirrored, !stride);
  });
}

TEST(vehicle_body, has_about_as_many_triangles_as_its_detail_says) {
  for_each_body([](const TriangleMesh& mesh, Detail detail, const ObjectClass& row) {
    constexpr std::array kWanted{12.0, 100.0, 600.0, 6000.0};
    const double ratio =
        static_cast<double>(mesh.triangles.size()) / kWanted.at(static_cast<std::size_t>(detail));
    EXPECT_GT(ratio, detail == Detail::kBox ? 0.999 : 0.4);
    // A cyclist has thirteen parts, and each part needs a minimum number of triangles.
    EXPECT_LT(ratio, detail == Detail::kBox ? 1.001 : row.id == Class::kCyclist ? 2.9 : 2.5);
  });
}

}  // namespace
}  // namespace infrasim
