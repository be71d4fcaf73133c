#include "pointops/voxel_pairs.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <functional>
#include <stdexcept>
#include <string>

#include "pointops/limits.h"

namespace pointops {

namespace {

constexpr std::int64_t kWord = 64;

/// A set of integers below a limit, with the rank of each member.
class RankedSet {
 public:
  explicit RankedSet(std::int64_t limit)
      : words_(static_cast<std::size_t>((limit + kWord - 1) / kWord)) {}

  void insert(std::int64_t key) { words_[word(key)] |= std::uint64_t{1} << (key % kWord); }

  /// Returns all members in increasing order. `at_most` is an upper limit of their number. rank()
  /// may be called after this function.
  std::vector<std::int64_t> members(std::size_t at_most) {
    std::vector<std::int64_t> keys;
    keys.reserve(at_most);
    before_.resize(words_.size());
    for (std::size_t w = 0; w < words_.size(); ++w) {
      before_[w] = static_cast<std::int32_t>(keys.size());
      for (std::uint64_t left = words_[w]; left != 0; left &= left - 1)
        keys.push_back(static_cast<std::int64_t>(w) * kWord + std::countr_zero(left));
    }
    return keys;
  }

  std::int64_t rank(std::int64_t member) const {
    const std::uint64_t below = (std::uint64_t{1} << (member % kWord)) - 1;
    return before_[word(member)] + std::popcount(words_[word(member)] & below);
  }

 private:
  static std::size_t word(std::int64_t key) { return static_cast<std::size_t>(key / kWord); }

  std::vector<std::uint64_t> words_;
  std::vector<std::int32_t> before_;
};

struct Arrival {
  std::int64_t offset;  ///< position along one axis of the kernel
  std::int64_t at;      ///< position along the same axis of the target grid
};

/// Lists, for each coordinate along one axis, the target coordinates that it reaches.
class Arrivals {
 public:
  Arrivals(const Reach& reach, std::size_t axis) {
    for (std::int64_t from = 0; from < reach.shape[axis]; ++from) {
      starts_.push_back(all_.size());
      for (std::int64_t offset = 0; offset < reach.kernel[axis]; ++offset) {
        const std::int64_t moved = from + reach.padding[axis] - offset;
        const std::int64_t at = moved / reach.stride[axis];
        if (moved >= 0 && moved % reach.stride[axis] == 0 && at < reach.target_shape[axis])
          all_.push_back({.offset = offset, .at = at});
      }
    }
    starts_.push_back(all_.size());
  }

  std::span<const Arrival> of(std::int64_t coordinate) const {
    const auto from = static_cast<std::size_t>(coordinate);
    return std::span(all_).subspan(starts_[from], starts_[from + 1] - starts_[from]);
  }

 private:
  std::vector<Arrival> all_;
  std::vector<std::size_t> starts_;
};

void check_increasing(std::span<const std::int64_t> keys) {
  const auto at = std::ranges::adjacent_find(keys, std::ranges::greater_equal()) - keys.begin();
  if (at < std::ssize(keys))
    throw std::invalid_argument("keys: expected increasing keys, got " + std::to_string(keys[at]) +
                                " before " + std::to_string(keys[at + 1]));
}

constexpr std::array kAxes{"z", "y", "x"};
// maximum number of elements of Arrivals along an axis; each element has 16 bytes
constexpr std::int64_t kMostArrivals = std::int64_t{1} << 24;
constexpr std::int64_t kMostOffsets = std::int64_t{1}
                                      << 20;  // maximum number of offsets of a kernel

/// @throws std::invalid_argument for sizes along an axis that are out of bounds
void check_axis(const Reach& reach, std::size_t axis) {
  const auto name = [&](const char* what) { return std::string(what) + ", " + kAxes[axis]; };
  check_between(name("shape"), reach.shape[axis], 0, kMostArrivals);
  check_between(name("kernel"), reach.kernel[axis], 0, kMostOffsets);
  check_between(name("stride"), reach.stride[axis], 1, kMostVoxels);
  check_between(name("padding"), reach.padding[axis], 0, kMostVoxels);
  check_between(name("target_shape"), reach.target_shape[axis], 0, kMostVoxels);
  checked_product(name("shape x kernel"), {reach.shape[axis], reach.kernel[axis]}, kMostArrivals);
}

/// Returns the number of batches.
/// @throws std::invalid_argument for coordinates outside the grid, or a target that is too large
std::int64_t check_reach(std::span<const std::int64_t> coordinates, const Reach& reach) {
  for (std::size_t axis = 0; axis < 3; ++axis) check_axis(reach, axis);
  std::int64_t batches = 0;
  for (std::size_t i = 0; i < coordinates.size(); ++i) {
    const std::size_t column = i % 4;
    const std::int64_t end = column == 0 ? kMostVoxels : reach.shape[column - 1];
    if (coordinates[i] < 0 || coordinates[i] >= end)
      throw std::invalid_argument("coordinates: expected column " + std::to_string(column) +
                                  " from 0 to below " + std::to_string(end) + ", got " +
                                  std::to_string(coordinates[i]) + " in row " +
                                  std::to_string(i / 4));
    if (column == 0) batches = std::max(batches, coordinates[i] + 1);
  }
  const auto& [z, y, x] = reach.target_shape;
  checked_product("batches x target_shape", {batches, z, y, x}, kMostVoxels);
  const auto& [oz, oy, ox] = reach.kernel;
  checked_product("coordinates x kernel", {std::ssize(coordinates) / 4, oz, oy, ox}, kMostSteps);
  checked_product("kernel", {oz, oy, ox}, kMostOffsets);
  return batches;
}

}  // namespace

VoxelPairs shifted_pairs(std::span<const std::int64_t> keys, std::span<const std::int64_t> steps) {
  check_increasing(keys);
  checked_product("keys x steps", {std::ssize(keys), std::ssize(steps)}, kMostSteps);
  VoxelPairs pairs;
  for (const std::int64_t step : steps) {
    const std::size_t before = pairs.inputs.size();
    // Both lists of keys increase, so one pass over them finds all pairs.
    std::size_t input = 0;
    for (std::size_t output = 0; output < keys.size(); ++output) {
      std::int64_t wanted = 0;
      if (__builtin_add_overflow(keys[output], step, &wanted)) {
        if (step > 0) break;  // all following sums are above every key
        continue;
      }
      while (input < keys.size() && keys[input] < wanted) ++input;
      if (input == keys.size()) break;
      if (keys[input] == wanted) {
        pairs.inputs.push_back(static_cast<std::int64_t>(input));
        pairs.outputs.push_back(static_cast<std::int64_t>(output));
      }
    }
    pairs.counts.push_back(static_cast<std::int64_t>(pairs.inputs.size() - before));
  }
  return pairs;
}

ReachedVoxels reached_voxels(std::span<const std::int64_t> coordinates, const Reach& reach) {
  const std::int64_t batches = check_reach(coordinates, reach);
  const auto& [shape, kernel, stride, padding, target] = reach;
  const Arrivals along_z(reach, 0), along_y(reach, 1), along_x(reach, 2);
  const std::size_t n = coordinates.size() / 4;
  const auto for_each_pair = [&](const auto& visit) {
    for (std::size_t row = 0; row < n; ++row) {
      const std::int64_t* voxel = coordinates.data() + 4 * row;
      for (const Arrival& z : along_z.of(voxel[1]))
        for (const Arrival& y : along_y.of(voxel[2]))
          for (const Arrival& x : along_x.of(voxel[3]))
            visit(
                static_cast<std::size_t>((z.offset * kernel[1] + y.offset) * kernel[2] + x.offset),
                row, ((voxel[0] * target[0] + z.at) * target[1] + y.at) * target[2] + x.at);
    }
  };

  ReachedVoxels result;
  VoxelPairs& pairs = result.pairs;
  pairs.counts.resize(static_cast<std::size_t>(kernel[0] * kernel[1] * kernel[2]));
  for_each_pair([&](std::size_t offset, std::size_t, std::int64_t) { ++pairs.counts[offset]; });
  std::vector<std::size_t> next;
  std::size_t total = 0;
  for (const std::int64_t count : pairs.counts) {
    next.push_back(total);
    total += static_cast<std::size_t>(count);
  }
  check_between("pairs", static_cast<std::int64_t>(total), 0, kMostResults);

  RankedSet reached(batches * target[0] * target[1] * target[2]);
  pairs.inputs.resize(total);
  pairs.outputs.resize(total);
  for_each_pair([&](std::size_t offset, std::size_t row, std::int64_t key) {
    pairs.inputs[next[offset]] = static_cast<std::int64_t>(row);
    pairs.outputs[next[offset]++] = key;
    reached.insert(key);
  });
  result.keys = reached.members(total);
  for (std::int64_t& output : pairs.outputs) output = reached.rank(output);
  return result;
}

}  // namespace pointops
