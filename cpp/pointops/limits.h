#pragma once

#include <cstdint>
#include <initializer_list>
#include <stdexcept>
#include <string>

// Limits of the sizes of operations. With these limits, products fit into 64 bits and results fit
// into memory. Detectors use far smaller sizes.

namespace pointops {

/// maximum number of values in a result: 2 GiB of int64
inline constexpr std::int64_t kMostResults = std::int64_t{1} << 28;
/// maximum number of voxels in a grid: 1 GiB of bits
inline constexpr std::int64_t kMostVoxels = std::int64_t{1} << 33;
/// maximum number of steps in a loop, which take some seconds
inline constexpr std::int64_t kMostSteps = std::int64_t{1} << 30;

/// @throws std::invalid_argument as "NAME: expected LOW to HIGH, got VALUE"
inline void check_between(const std::string& name, std::int64_t value, std::int64_t low,
                          std::int64_t high) {
  if (value < low || value > high)
    throw std::invalid_argument(name + ": expected " + std::to_string(low) + " to " +
                                std::to_string(high) + ", got " + std::to_string(value));
}

/// Returns the product of non-negative factors.
/// @throws std::invalid_argument if a factor is negative or the product is above `most`, which is
///   below 2^62
inline std::int64_t checked_product(const std::string& name,
                                    std::initializer_list<std::int64_t> factors,
                                    std::int64_t most) {
  std::int64_t product = 1;
  for (const std::int64_t factor : factors) {
    check_between(name, factor, 0, most);
    if (factor > 0 && product > most / factor)
      throw std::invalid_argument(name + ": expected a product up to " + std::to_string(most) +
                                  ", got more");
    product *= factor;
  }
  return product;
}

}  // namespace pointops
