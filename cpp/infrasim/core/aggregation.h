#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace infrasim {

/// How the rays of a frame sample the motion of objects.
struct Aggregation {
  std::string word = "exact";  ///< the word in the configuration
  int slices = 0;              ///< frozen instants per frame; 0: every ray sees its own firing time
};

inline constexpr const char* kAggregationWords = "exact, instant or slices:N with N from 1 to 1000";

/// Parses `exact`, `instant` (one frozen instant at the middle of the frame) or `slices:N`.
/// @return nothing for any other word
std::optional<Aggregation> parse_aggregation(const std::string& word);

/// A part of a frame, as shares of the frame, whose rays see one state of the objects.
struct WorldSlice {
  double from = 0;
  double to = 1;
  bool frozen = false;  ///< objects stand still at the middle of the slice
  double middle() const { return (from + to) / 2; }
};

/// One moving slice for `exact`, otherwise n frozen ones.
std::vector<WorldSlice> world_slices(const Aggregation& aggregation);

}  // namespace infrasim
