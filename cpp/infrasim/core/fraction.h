#pragma once

#include <cstdint>

namespace infrasim {

/// A positive number written as a fraction, such as 8125/4, in lowest terms.
struct Fraction {
  std::int64_t numerator = 1;
  std::int64_t denominator = 1;

  double value() const { return static_cast<double>(numerator) / static_cast<double>(denominator); }
};

}  // namespace infrasim
