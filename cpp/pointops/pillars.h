#pragma once

#include <cstdint>
#include <span>

namespace pointops {

/// Square cells of a canvas, which is the ground seen from above. Lengths are in metres.
struct PillarGrid {
  float low_x, low_y;  // lower corner of the first cell
  float middle_z;      // middle height of the area
  float side;          // side of a cell
  std::int64_t rows, columns;
};

/// The linear layer of a pillar encoder. The inputs of a point are: x y z; the offset to the mean
/// of its pillar (3); the offset to the middle of the pillar (3); the other columns of the point,
/// from the last to the first.
struct PillarLayer {
  std::span<const float> weight;  // weights, shape (inputs, features), row-major
  std::span<const float> bias;    // one per feature
  std::int64_t first;             // the layer does not use the inputs before this index
};

/// A 3 x 3 convolution of the canvas with a border of zeros, followed by ReLU.
struct CanvasLayer {
  std::span<const float> weight;  // weights, shape (3, 3, features, outputs), row-major
  std::span<const float> bias;    // one per output
  std::int64_t stride;
};

/// Computes the first convolution on the canvas of a cloud. A cell of the canvas has the maximum of
/// ReLU(linear layer) over its points; a cell without points is 0. Only cells with points are
/// computed, so the canvas itself is never made.
/// @param points  n * point_columns, row-major
/// @param map     shape (outputs, rows / stride, columns / stride), row-major; the previous values
///   are overwritten
/// @throws std::invalid_argument if the sizes of the arrays are inconsistent or a point is outside
///   the grid
void pillar_map(std::span<const float> points, std::int64_t point_columns, const PillarGrid& grid,
                const PillarLayer& encoder, const CanvasLayer& layer, std::span<float> map);

}  // namespace pointops
