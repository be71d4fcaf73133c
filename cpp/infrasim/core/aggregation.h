#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace infrasim {

/// How the rays of a frame sample the motion of objects.
struct Aggregation {
  std::string word = "exact";  ///< value of the key `aggregation` in a scene file
  int slices = 0;  ///< number of frozen instants per frame; with 0, each ray meets the objects at
                   ///< its own firing time
};

inline constexpr const char* kAggregationWords = "exact, instant or slices:N with N from 1 to 1000";

/// Parses `exact`, `instant` (one frozen instant at the middle of the frame) or `slices:N`.
/// @return no value for any other word
std::optional<Aggregation> parse_aggregation(const std::string& word);

/// A part of a frame. `from` and `to` are shares of the frame's duration.
struct WorldSlice {
  double from = 0;
  double to = 1;
  bool frozen = false;  ///< whether objects stand still, where they are at the middle of the slice
  double middle() const { return (from + to) / 2; }
};

/// Returns one slice with moving objects for `exact`, otherwise `aggregation.slices` slices with
/// frozen objects.
std::vector<WorldSlice> world_slices(const Aggregation& aggregation);

}  // namespace infrasim
