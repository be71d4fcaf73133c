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

/// Calls check(mesh, detail) for each class at each level of detail.
template <class Check>
void for_each_body(const Check& check) {
  for (const ObjectClass& row : kObjectClasses)
    for (const Detail detail : {Detail::kBox, Detail::kLow, Detail::kMid, Detail::kFine}) {
      SCOPED_TRACE(std::string(row.name) + " " +
                   enum_names(detail)[static_cast<std::size_t>(detail)]);
      check(build_vehicle_body(row.id, detail), detail);
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
  for_each_body([](const TriangleMesh& mesh, Detail) {
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
  for_each_body([](const TriangleMesh& mesh, Detail) {
    // Round each triangle, an edge is passed once; its neighbour passes it the other way.
    std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
    for (const auto& t : mesh.triangles)
      for (std::size_t i = 0; i < 3; ++i) ++edges[{t.at(i), t.at((i + 1) % 3)}];
    for (const auto& [edge, count] : edges) {
      EXPECT_EQ(count, 1);
      EXPECT_EQ(edges.count({edge.second, edge.first}), 1U);
    }
  });
}

TEST(vehicle_body, takes_up_a_good_part_of_its_box) {
  for_each_body([](const TriangleMesh& mesh, Detail) {
    double volume = 0;  // by the divergence theorem
    for (const auto& t : mesh.triangles) {
      const auto vertex = [&](std::size_t i) {
        const auto& v = mesh.vertices.at(t.at(i));
        return Vec3{v[0], v[1], v[2]};
      };
      const Vec3 a = vertex(0), b = vertex(1), c = vertex(2);
      volume += (a.x * (b.y * c.z - b.z * c.y) + a.y * (b.z * c.x - b.x * c.z) +
                 a.z * (b.x * c.y - b.y * c.x)) /
                6;
    }
    EXPECT_GT(std::abs(volume), 0.25);
    EXPECT_LE(std::abs(volume), 1.000001);
  });
}

TEST(vehicle_body, is_the_same_on_its_left_and_right) {
  for_each_body([](const TriangleMesh& mesh, Detail) {
    for (const auto& v : mesh.vertices)
      EXPECT_TRUE(std::ranges::any_of(mesh.vertices, [&](const auto& other) {
        return std::abs(other[0] - v[0]) + std::abs(other[1] + v[1]) + std::abs(other[2] - v[2]) <
               1e-6F;
      }));
  });
}

TEST(vehicle_body, has_about_as_many_triangles_as_its_detail_says) {
  for_each_body([](const TriangleMesh& mesh, Detail detail) {
    constexpr std::array kWanted{12.0, 100.0, 600.0, 6000.0};
    const double ratio =
        static_cast<double>(mesh.triangles.size()) / kWanted.at(static_cast<std::size_t>(detail));
    EXPECT_GT(ratio, detail == Detail::kBox ? 0.999 : 0.4);
    EXPECT_LT(ratio, detail == Detail::kBox ? 1.001 : 2.5);
  });
}

}  // namespace
}  // namespace infrasim
