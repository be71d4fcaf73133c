#include "infrasim/core/aggregation.h"

#include <charconv>

namespace infrasim {

std::optional<Aggregation> parse_aggregation(const std::string& word) {
  if (word == "exact") return Aggregation{word, 0};
  if (word == "instant") return Aggregation{word, 1};
  constexpr std::string_view kPrefix = "slices:";
  if (!word.starts_with(kPrefix)) return std::nullopt;
  const char* end = word.data() + word.size();
  int slices = 0;
  const auto [stop, error] = std::from_chars(word.data() + kPrefix.size(), end, slices);
  if (error != std::errc{} || stop != end || slices < 1 || slices > 1000) return std::nullopt;
  return Aggregation{word, slices};
}

std::vector<WorldSlice> world_slices(const Aggregation& aggregation) {
  if (aggregation.slices == 0) return {WorldSlice{}};
  std::vector<WorldSlice> slices;
  const double n = aggregation.slices;
  for (int i = 0; i < aggregation.slices; ++i) slices.push_back({i / n, (i + 1) / n, true});
  return slices;
}

}  // namespace infrasim
