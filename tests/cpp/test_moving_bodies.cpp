#include "infrasim/raycast/moving_bodies.h"

#include <gtest/gtest.h>

#include <random>
#include <vector>

namespace infrasim {
namespace {

std::vector<std::size_t> bodies_in(const BodyIndex& index, const ViewBounds& view) {
  std::vector<std::size_t> out;
  index.for_each_in(view, [&](std::size_t i) {
    out.push_back(i);
    return true;
  });
  return out;
}

ViewBounds towards(Vec3 p) {
  const double n = norm(p);
  ViewBounds view;
  view.add(static_cast<float>(p.x / n), static_cast<float>(p.y / n), static_cast<float>(p.z / n));
  return view;
}

TEST(bearing, grows_with_azimuth_from_minus_2_to_2) {
  float before = -2.1F;
  for (double azimuth = -kPi; azimuth <= kPi; azimuth += 0.001) {
    const float b =
        bearing(static_cast<float>(std::cos(azimuth)), static_cast<float>(std::sin(azimuth)));
    EXPECT_GT(b, before);
    before = b;
  }
  EXPECT_NEAR(bearing(1, 0), 0, 1e-6);
  EXPECT_NEAR(bearing(0, 1), 1, 1e-6);
  EXPECT_EQ(bearing(0, 0), 0);
}

TEST(body_index, finds_each_body_in_the_direction_of_each_of_its_points_at_any_time) {
  std::mt19937 random(7);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  for (int repeat = 0; repeat < 50; ++repeat) {
    std::vector<MovingBody> bodies;
    for (int i = 0; i < 150; ++i) {
      Box3d from{uniform(-80, 80), uniform(-80, 80), uniform(-8, 3),    uniform(1, 14),
                 uniform(0.5, 3),  uniform(1, 4),    uniform(-kPi, kPi)};
      if (i == 0) from = {-30, 0, -5, 4, 2, 2, kPi};  // behind the sensor
      if (i == 1) from = {0.3, 0.2, -5, 4, 2, 2, 1};  // below the sensor
      Box3d to = from;
      to.x += uniform(-4, 4);
      to.y += uniform(-4, 4);
      to.z += uniform(-0.5, 0.5);
      to.heading += uniform(-0.6, 0.6);
      bodies.push_back({0, from, to});
    }
    BodyIndex index;
    index.set(bodies);
    for (std::size_t i = 0; i < bodies.size(); ++i)
      for (int n = 0; n < 20; ++n) {
        const Box3d box = box_at(bodies[i], uniform(0, 1));
        const double x = box.dx * uniform(-0.5, 0.5), y = box.dy * uniform(-0.5, 0.5);
        const double c = std::cos(box.heading), s = std::sin(box.heading);
        const Vec3 p{box.x + c * x - s * y, box.y + s * x + c * y,
                     box.z + box.dz * uniform(-0.5, 0.5)};
        const auto near = bodies_in(index, towards(p));
        EXPECT_TRUE(std::ranges::binary_search(near, i)) << repeat << " " << i;
        EXPECT_TRUE(index.any_in(towards(p)));
      }
  }
}

TEST(body_index, leaves_out_bodies_that_a_view_passes) {
  BodyIndex index;
  const Box3d box{30, 0, -5, 4.5, 2, 1.5, 0.3};
  index.set(std::vector<MovingBody>{{0, box, box}});
  EXPECT_EQ(bodies_in(index, towards({30, 0, -5})).size(), 1);
  EXPECT_FALSE(index.any_in(towards({30, 4, -5})));
  EXPECT_FALSE(index.any_in(towards({-30, 0, -5})));
  EXPECT_FALSE(index.any_in(towards({30, 0, -2})));
  EXPECT_FALSE(index.any_in(towards({30, 0, -9})));
  EXPECT_FALSE(index.any_in(ViewBounds{}));
}

}  // namespace
}  // namespace infrasim
