#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace infrasim {

/// How the rays of a frame see moving objects.
struct Aggregation {
  std::string word = "exact";  ///< as the configuration has it
  int slices = 0;              ///< frozen worlds per frame; 0: every ray at its own firing time
};

inline constexpr const char* kAggregationWords = "exact, instant or slices:N with N from 1 to 1000";

/// `exact`, `instant` (one frozen world at the middle of the frame) or `slices:N`.
/// @return nothing if the word is none of them
std::optional<Aggregation> parse_aggregation(const std::string& word);

/// A stretch of a frame, as shares of it, whose rays see one state of the world.
struct WorldSlice {
  double from = 0;
  double to = 1;
  bool frozen = false;  ///< objects stand still at the middle of the slice
  double middle() const { return (from + to) / 2; }
};

/// One moving slice for `exact`, n frozen ones else.
std::vector<WorldSlice> world_slices(const Aggregation& aggregation);

}  // namespace infrasim
