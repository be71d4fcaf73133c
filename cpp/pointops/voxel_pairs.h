#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace pointops {

/// Pairs of an input voxel and an output voxel, each given by its row in the list of voxels. The
/// pairs are grouped by the offset between the two voxels.
struct VoxelPairs {
  std::vector<std::int64_t> inputs;
  std::vector<std::int64_t> outputs;
  std::vector<std::int64_t> counts;  ///< number of pairs for each offset
};

/// Returns the pairs of voxels whose keys differ by one of the steps.
/// @param keys  increasing keys without duplicates; outputs and inputs are rows of this list
/// @return for each step, the pairs with keys[input] = keys[output] + step, by increasing output
/// @throws std::invalid_argument if the keys do not increase, or if the work exceeds kMostSteps
VoxelPairs shifted_pairs(std::span<const std::int64_t> keys, std::span<const std::int64_t> steps);

/// Parameters of a sparse convolution from one grid to a coarser one, with a value for each of the
/// axes z, y, x.
struct Reach {
  std::array<std::int64_t, 3> shape;  ///< shape of the input grid
  std::array<std::int64_t, 3> kernel;
  std::array<std::int64_t, 3> stride;
  std::array<std::int64_t, 3> padding;
  std::array<std::int64_t, 3> target_shape;
};

struct ReachedVoxels {
  VoxelPairs pairs;
  /// key of each output voxel, ((batch * Z + z) * Y + y) * X + x, increasing; (Z, Y, X) is the
  /// shape of the target grid
  std::vector<std::int64_t> keys;
};

/// Returns every output voxel that the kernel reaches from the inputs, and the pairs of inputs and
/// outputs: stride * output = input + padding - offset. The function uses one bit of memory for
/// each voxel of the target grid up to the last batch.
/// @param coordinates  4 * n, batch z y x, within the shape
/// @throws std::invalid_argument for coordinates outside the shape, a negative size, a stride below
///   1, or sizes above the limits in limits.h
ReachedVoxels reached_voxels(std::span<const std::int64_t> coordinates, const Reach& reach);

}  // namespace pointops
