#include "pointops/pillars.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <stdexcept>
#include <vector>

// The loops over channels are compiled for several instruction sets. One of them is chosen at run
// time.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define POINTOPS_FAST __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define POINTOPS_FAST
#endif

namespace pointops {

namespace {

constexpr std::size_t kCoordinates = 9;  // number of inputs that come from x y z
constexpr std::size_t kMostInputs = 16;

using Xyz = std::array<float, 3>;

struct Pillar {
  std::int64_t row, column;
  Xyz middle{};
  float count = 0;
  Xyz sum{};
};

/// The pillars of a cloud, and the pillar of each point.
struct Members {
  std::vector<Pillar> pillars;
  std::vector<std::int32_t> pillar_of;
};

/// Returns the number of the cell, along one axis, that contains a position. A position on the
/// upper border is in the last cell.
std::int64_t cell_along(float at, float low, float side, std::int64_t cells) {
  const float cell = (at - low) / side;
  if (!(cell > -1 && cell < static_cast<float>(cells) + 1))
    throw std::invalid_argument("points: expected points inside the grid, got a point outside");
  return std::min(static_cast<std::int64_t>(cell), cells - 1);
}

Xyz middle_of(std::int64_t row, std::int64_t column, const PillarGrid& grid) {
  return {grid.low_x + (static_cast<float>(column) + 0.5F) * grid.side,
          grid.low_y + (static_cast<float>(row) + 0.5F) * grid.side, grid.middle_z};
}

Members members_of(std::span<const float> points, std::size_t point_columns,
                   const PillarGrid& grid) {
  Members members;
  std::vector<std::int32_t> pillar_in(static_cast<std::size_t>(grid.rows * grid.columns), -1);
  members.pillar_of.reserve(points.size() / point_columns);
  for (; !points.empty(); points = points.subspan(point_columns)) {
    const std::int64_t column = cell_along(points[0], grid.low_x, grid.side, grid.columns);
    const std::int64_t row = cell_along(points[1], grid.low_y, grid.side, grid.rows);
    const std::int64_t cell = row * grid.columns + column;
    std::int32_t& number = pillar_in[static_cast<std::size_t>(cell)];
    if (number < 0) {
      number = static_cast<std::int32_t>(members.pillars.size());
      members.pillars.push_back(
          {.row = row, .column = column, .middle = middle_of(row, column, grid)});
    }
    Pillar& pillar = members.pillars[static_cast<std::size_t>(number)];
    pillar.count += 1;
    for (std::size_t axis = 0; axis < 3; ++axis) pillar.sum[axis] += points[axis];
    members.pillar_of.push_back(number);
  }
  return members;
}

/// Writes all inputs of a point, including the inputs that the layer does not use.
[[gnu::always_inline]] inline void write_inputs(std::span<const float> point, const Pillar& pillar,
                                                std::array<float, kMostInputs>& inputs) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    inputs[axis] = point[axis];
    inputs[3 + axis] = point[axis] - pillar.sum[axis] / pillar.count;
    inputs[6 + axis] = point[axis] - pillar.middle[axis];
  }
  for (std::size_t i = 3; i < point.size(); ++i)
    inputs[kCoordinates + point.size() - 1 - i] = point[i];
}

constexpr std::size_t kTogether = 32;  // number of channels whose sums stay in registers

/// Adds the product of a vector (inputs) and a matrix (inputs, outputs) to the sums.
[[gnu::always_inline]] inline void add_product(const float* values, std::size_t inputs,
                                               const float* matrix, std::size_t outputs,
                                               float* sums) {
  std::size_t c = 0;
  for (; c + kTogether <= outputs; c += kTogether) {
    std::array<float, kTogether> some;
    std::copy_n(sums + c, kTogether, some.begin());
    for (std::size_t k = 0; k < inputs; ++k)
      for (std::size_t i = 0; i < kTogether; ++i)
        some[i] += values[k] * matrix[k * outputs + c + i];
    std::copy_n(some.begin(), kTogether, sums + c);
  }
  for (; c < outputs; ++c)
    for (std::size_t k = 0; k < inputs; ++k) sums[c] += values[k] * matrix[k * outputs + c];
}

/// Returns the features of all pillars, row-major.
POINTOPS_FAST
std::vector<float> features_of(std::span<const float> points, std::size_t point_columns,
                               const Members& members, const PillarLayer& layer) {
  const std::size_t width = layer.bias.size(), inputs = layer.weight.size() / width;
  std::vector<float> features(members.pillars.size() * width, 0.0F), sums(width);
  std::array<float, kMostInputs> values{};
  for (std::size_t i = 0; i < members.pillar_of.size(); ++i) {
    const auto pillar = static_cast<std::size_t>(members.pillar_of[i]);
    write_inputs(points.subspan(i * point_columns, point_columns), members.pillars[pillar], values);
    std::copy(layer.bias.begin(), layer.bias.end(), sums.begin());
    add_product(&values[static_cast<std::size_t>(layer.first)], inputs, layer.weight.data(), width,
                sums.data());
    // The features start at 0, so the maximum includes the ReLU.
    float* feature = &features[pillar * width];
    for (std::size_t c = 0; c < width; ++c) feature[c] = std::max(feature[c], sums[c]);
  }
  return features;
}

/// Returns the pillars in each row of the grid.
std::vector<std::vector<std::int32_t>> by_row(const std::vector<Pillar>& pillars,
                                              const PillarGrid& grid) {
  std::vector<std::vector<std::int32_t>> rows(static_cast<std::size_t>(grid.rows));
  for (std::size_t p = 0; p < pillars.size(); ++p)
    rows[static_cast<std::size_t>(pillars[p].row)].push_back(static_cast<std::int32_t>(p));
  return rows;
}

/// Computes the convolution row by row, only at cells whose kernel covers a pillar.
POINTOPS_FAST
void convolve(const std::vector<float>& features, const std::vector<Pillar>& pillars,
              const PillarGrid& grid, const CanvasLayer& layer, std::span<float> map) {
  const std::size_t channels = layer.bias.size(), width = layer.weight.size() / (9 * channels);
  const std::int64_t stride = layer.stride, rows = grid.rows / stride,
                     columns = grid.columns / stride;
  const auto numbers = by_row(pillars, grid);
  // sums of a row of cells, cell by cell
  std::vector<float> sums(static_cast<std::size_t>(columns) * channels);
  for (std::int64_t r = 0; r < rows; ++r) {
    for (std::size_t i = 0; i < sums.size(); i += channels)
      std::copy(layer.bias.begin(), layer.bias.end(), &sums[i]);
    for (std::int64_t down = 0; down < 3; ++down) {
      const std::int64_t row = stride * r + down - 1;
      if (row < 0 || row >= grid.rows) continue;
      for (const std::int32_t p : numbers[static_cast<std::size_t>(row)]) {
        const std::int64_t column = pillars[static_cast<std::size_t>(p)].column;
        const std::int64_t first = std::max<std::int64_t>(0, (column + stride - 2) / stride);
        for (std::int64_t c = first; c <= std::min((column + 1) / stride, columns - 1); ++c) {
          const auto tap = static_cast<std::size_t>(3 * down + column + 1 - stride * c);
          add_product(&features[static_cast<std::size_t>(p) * width], width,
                      &layer.weight[tap * width * channels], channels,
                      &sums[static_cast<std::size_t>(c) * channels]);
        }
      }
    }
    float* out = &map[static_cast<std::size_t>(r * columns)];
    for (std::size_t k = 0; k < channels; ++k, out += rows * columns)
      for (std::size_t c = 0; c < static_cast<std::size_t>(columns); ++c)
        out[c] = std::max(sums[c * channels + k], 0.0F);
  }
}

void check(std::size_t points, std::size_t point_columns, const PillarGrid& grid,
           const PillarLayer& encoder, const CanvasLayer& layer, std::size_t map) {
  const std::size_t width = encoder.bias.size(), channels = layer.bias.size();
  const bool sizes = width > 0 && channels > 0 && encoder.weight.size() % width == 0 &&
                     encoder.first >= 0 &&
                     static_cast<std::size_t>(encoder.first) + encoder.weight.size() / width <=
                         kCoordinates + point_columns - 3 &&
                     layer.weight.size() == 9 * width * channels;
  if (point_columns < 3 || points % point_columns != 0 ||
      kCoordinates + point_columns - 3 > kMostInputs || !sizes)
    throw std::invalid_argument(
        "points, weight, bias: expected weights for each input and a bias for each output of "
        "a layer, got other sizes");
  if (grid.rows < 1 || grid.columns < 1 || layer.stride < 1 || grid.rows % layer.stride != 0 ||
      grid.columns % layer.stride != 0 ||
      map != channels * static_cast<std::size_t>(grid.rows / layer.stride) *
                 static_cast<std::size_t>(grid.columns / layer.stride))
    throw std::invalid_argument(
        "map: expected (outputs, rows / stride, columns / stride) values, got another size");
}

}  // namespace

void pillar_map(std::span<const float> points, std::int64_t point_columns, const PillarGrid& grid,
                const PillarLayer& encoder, const CanvasLayer& layer, std::span<float> map) {
  const auto columns_of_point = static_cast<std::size_t>(std::max<std::int64_t>(point_columns, 0));
  check(points.size(), columns_of_point, grid, encoder, layer, map.size());
  const Members members = members_of(points, columns_of_point, grid);
  const auto features = features_of(points, columns_of_point, members, encoder);

  convolve(features, members.pillars, grid, layer, map);
}

}  // namespace pointops
