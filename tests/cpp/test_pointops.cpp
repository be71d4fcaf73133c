#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <vector>

#include "pointops/ball_query.h"
#include "pointops/farthest_points.h"
#include "pointops/pillars.h"
#include "pointops/suppression.h"
#include "pointops/voxel_pairs.h"

namespace pointops {
namespace {

using Rows = std::vector<std::int64_t>;

/// Returns random points on a coarse grid, so that many distances and points are equal.
std::vector<float> points_on_a_grid(std::size_t n, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<float> xyz(3 * n);
  for (std::size_t i = 0; i < xyz.size(); ++i)
    xyz[i] = 0.5F * static_cast<float>(random() % (i % 3 == 2 ? 4 : 60));
  return xyz;
}

float squared_distance(const std::vector<float>& a, std::size_t i, const std::vector<float>& b,
                       std::size_t j) {
  const float dx = a[3 * i] - b[3 * j], dy = a[3 * i + 1] - b[3 * j + 1],
              dz = a[3 * i + 2] - b[3 * j + 2];
  return dx * dx + dy * dy + dz * dz;
}

TEST(farthest_points, are_those_of_the_plain_loop) {
  for (const std::size_t n : {1U, 2U, 127U, 128U, 129U, 2000U}) {
    const auto xyz = points_on_a_grid(n, 1);
    std::vector<float> apart(n, std::numeric_limits<float>::infinity());
    Rows expected;
    for (std::size_t row = 0; expected.size() < 300;) {
      expected.push_back(static_cast<std::int64_t>(row));
      for (std::size_t i = 0; i < n; ++i)
        apart[i] = std::min(apart[i], squared_distance(xyz, i, xyz, row));
      row = static_cast<std::size_t>(std::max_element(apart.begin(), apart.end()) - apart.begin());
    }
    EXPECT_EQ(farthest_points(xyz, 300), expected) << n << " points";
  }
}

TEST(farthest_points, begin_again_when_all_are_taken) {
  const std::vector<float> xyz{0, 0, 0, 1, 0, 0, 5, 0, 0, 1, 0, 0};
  EXPECT_EQ(farthest_points(xyz, 5), (Rows{0, 2, 1, 0, 0}));
  EXPECT_EQ(farthest_points(xyz, 0), Rows{});
  EXPECT_THROW(farthest_points({}, 3), std::invalid_argument);
  EXPECT_THROW(farthest_points(std::vector<float>{0, NAN, 0}, 3), std::invalid_argument);
}

TEST(ball_query, finds_what_a_loop_over_all_points_finds) {
  const auto points = points_on_a_grid(2000, 2);
  const auto centres = points_on_a_grid(100, 3);
  for (const float radius : {0.1F, 0.5F, 1.0F, 7.3F, 1000.0F}) {
    const Balls balls = ball_query(points, centres, radius, 8);
    for (std::size_t b = 0; b < 100; ++b) {
      Rows inside;
      for (std::size_t i = 0; i < 2000 && inside.size() < 8; ++i)
        if (squared_distance(points, i, centres, b) < radius * radius)
          inside.push_back(static_cast<std::int64_t>(i));
      EXPECT_EQ(balls.empty[b] != 0, inside.empty());
      inside.resize(8, inside.empty() ? 0 : inside.front());
      EXPECT_EQ(Rows(balls.rows.begin() + static_cast<std::ptrdiff_t>(8 * b),
                     balls.rows.begin() + static_cast<std::ptrdiff_t>(8 * b + 8)),
                inside);
    }
  }
}

TEST(ball_query, takes_centres_far_away_and_no_points) {
  const std::vector<float> points{1, 2, 3}, far{1e30F, -1e30F, 0};
  EXPECT_EQ(ball_query(points, far, 1, 2).empty, std::vector<std::uint8_t>{1});
  EXPECT_EQ(ball_query(points, points, 1, 2).rows, (Rows{0, 0}));
  EXPECT_EQ(ball_query({}, points, 1, 2).empty, std::vector<std::uint8_t>{1});
  EXPECT_TRUE(ball_query(points, {}, 1, 2).rows.empty());
  const std::vector<float> unknown{0, NAN, 0}, endless{0, 0, INFINITY};
  EXPECT_THROW(ball_query(unknown, points, 1, 2), std::invalid_argument);
  EXPECT_THROW(ball_query(points, endless, 1, 2), std::invalid_argument);
  EXPECT_THROW(ball_query(points, points, 0, 2), std::invalid_argument);
  EXPECT_THROW(ball_query(points, points, 1, 0), std::invalid_argument);
}

TEST(shifted_pairs, are_all_keys_that_differ_by_the_step) {
  const Rows keys{-3, 0, 1, 2, 7, 8};
  const Rows steps{-1, 1, 100};
  const VoxelPairs pairs = shifted_pairs(keys, steps);
  EXPECT_EQ(pairs.inputs, (Rows{1, 2, 4, 2, 3, 5}));
  EXPECT_EQ(pairs.outputs, (Rows{2, 3, 5, 1, 2, 4}));
  EXPECT_EQ(pairs.counts, (Rows{3, 3, 0}));
  EXPECT_EQ(shifted_pairs({}, steps).counts, (Rows{0, 0, 0}));
}

TEST(reached_voxels, are_those_whose_kernel_covers_a_voxel) {
  // Only along x: a kernel of 3 with stride 2 and padding 1 has 3 outputs for 6 voxels.
  const Reach reach{.shape = {1, 1, 6},
                    .kernel = {1, 1, 3},
                    .stride = {1, 1, 2},
                    .padding = {0, 0, 1},
                    .target_shape = {1, 1, 3}};
  const Rows voxels{1, 0, 0, 1, 0, 0, 0, 5};
  const ReachedVoxels reached = reached_voxels(voxels, reach);
  // In batch 1, x = 1 is at the right end of output 0 and at the left end of output 1. In batch 0,
  // x = 5 is at the right end of output 2 and at the left end of no output.
  EXPECT_EQ(reached.keys, (Rows{2, 3, 4}));
  EXPECT_EQ(reached.pairs.counts, (Rows{1, 0, 2}));
  EXPECT_EQ(reached.pairs.inputs, (Rows{0, 0, 1}));
  EXPECT_EQ(reached.pairs.outputs, (Rows{2, 1, 0}));
  EXPECT_TRUE(reached_voxels({}, reach).keys.empty());
}

TEST(pillar_map, is_the_convolution_of_the_highest_point_of_each_cell) {
  // The only input is the height. The canvas has the highest z of each cell: 3 at row 1, column 2,
  // and 5 at row 3, column 0. Each element of the kernel has a different weight.
  const std::vector<float> points{2.2F, 1.5F, 3, 2.9F, 1.1F, 2, 0.5F, 3.5F, 5};
  const PillarGrid grid{.low_x = 0, .low_y = 0, .middle_z = 0, .side = 1, .rows = 4, .columns = 4};
  const std::vector<float> height{1}, none{0}, taps{1, 2, 3, 4, 5, 6, 7, 8, 9}, bias{-9.5F};
  const PillarLayer encoder{.weight = height, .bias = none, .first = 2};
  for (const std::int64_t stride : {1, 2}) {
    std::vector<float> canvas(16, 0.0F), map(static_cast<std::size_t>(16 / (stride * stride)));
    canvas[4 + 2] = 3;
    canvas[12] = 5;
    pillar_map(points, 3, grid, encoder, {.weight = taps, .bias = bias, .stride = stride}, map);
    const auto at = [&](std::int64_t row, std::int64_t column) {
      const bool inside = row >= 0 && row < 4 && column >= 0 && column < 4;
      return inside ? canvas[static_cast<std::size_t>(4 * row + column)] : 0.0F;
    };
    std::size_t i = 0;
    for (std::int64_t row = 0; row < 4; row += stride)
      for (std::int64_t column = 0; column < 4; column += stride) {
        float sum = bias[0];
        for (std::int64_t k = 0; k < 9; ++k)
          sum += taps[static_cast<std::size_t>(k)] * at(row + k / 3 - 1, column + k % 3 - 1);
        EXPECT_FLOAT_EQ(map[i++], std::max(0.0F, sum)) << row << ' ' << column;
      }
  }
}

TEST(pillar_map, refuses_points_outside_the_grid) {
  const std::vector<float> one{1}, nine(9, 1.0F), outside{4.5F, 9, 0};
  std::vector<float> map(16);
  const PillarGrid grid{.low_x = 0, .low_y = 0, .middle_z = 0, .side = 1, .rows = 4, .columns = 4};
  EXPECT_THROW(pillar_map(outside, 3, grid, {.weight = one, .bias = one, .first = 0},
                          {.weight = nine, .bias = one, .stride = 1}, map),
               std::invalid_argument);
}

std::vector<double> car(double x, double y, double heading) {
  return {x, y, -5, 4, 2, 1.5, heading};
}

std::vector<double> all(const std::vector<std::vector<double>>& boxes) {
  std::vector<double> values;
  for (const auto& box : boxes) values.insert(values.end(), box.begin(), box.end());
  return values;
}

TEST(suppression, keeps_the_best_of_those_that_overlap) {
  // The IoU is 3/5 for the first and second box, 5/11 for the second and third, and 3/13 for the
  // first and third.
  const auto boxes = all({car(0, 0, 0), car(1, 0, 0), car(2.5, 0, 0), car(50, 0, 0)});
  EXPECT_EQ(suppress(boxes, 0.5, 10), (Rows{0, 2, 3}));
  EXPECT_EQ(suppress(boxes, 0.61, 10), (Rows{0, 1, 2, 3}));
  EXPECT_EQ(suppress(boxes, 0.2, 10), (Rows{0, 3}));
  EXPECT_EQ(suppress(boxes, 0.5, 2), (Rows{0, 2}));
  EXPECT_EQ(suppress(boxes, 0.5, 0), Rows{});
  EXPECT_EQ(suppress({}, 0.5, 10), Rows{});
}

TEST(suppression, knows_equal_turned_and_touching_boxes) {
  const double pi = std::acos(-1.0);
  EXPECT_EQ(suppress(all({car(3, 4, 0.3), car(3, 4, 0.3), car(3, 4, 0.3 + pi)}), 0.999, 10),
            Rows{0});
  EXPECT_EQ(suppress(all({car(3, 4, 0.3), car(3, 4, 0.3)}), 1, 10), (Rows{0, 1}));
  // The crossing cars have 2 x 2 of 12 square metres in common.
  EXPECT_EQ(suppress(all({car(0, 0, 0), car(0, 0, pi / 2)}), 0.33, 10), Rows{0});
  EXPECT_EQ(suppress(all({car(0, 0, 0), car(0, 0, pi / 2)}), 0.34, 10), (Rows{0, 1}));
  const auto beside = all({car(0, 0, 0.3), car(4 * std::cos(0.3), 4 * std::sin(0.3), 0.3)});
  EXPECT_EQ(suppress(beside, 0, 10), (Rows{0, 1}));
}

}  // namespace
}  // namespace pointops
