#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace infrasim {

/// How the rays of a frame see moving objects.
struct Aggregation {
  int slices = 0;  ///< frozen worlds per frame; 0: every ray at its own firing time

  bool exact() const { return slices == 0; }
};

inline constexpr const char* kAggregationWords = "exact, instant or slices:N with N from 1 to 1000";

/// `exact`, `instant` (one frozen world at the middle of the frame) or `slices:N`.
/// @return nothing if the text is none of them
std::optional<Aggregation> parse_aggregation(std::string_view text);

}  // namespace infrasim
