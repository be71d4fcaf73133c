#include "infrasim/core/aggregation.h"

#include "infrasim/core/numbers.h"

namespace infrasim {

std::optional<Aggregation> parse_aggregation(const std::string& word) {
  if (word == "exact") return Aggregation{word, 0};
  if (word == "instant") return Aggregation{word, 1};
  constexpr std::string_view kPrefix = "slices:";
  if (!word.starts_with(kPrefix)) return std::nullopt;
  const auto slices = parse_number<int>(std::string_view(word).substr(kPrefix.size()));
  if (!slices || *slices < 1 || *slices > 1000) return std::nullopt;
  return Aggregation{word, *slices};
}

std::vector<WorldSlice> world_slices(const Aggregation& aggregation) {
  if (aggregation.slices == 0) return {WorldSlice{}};
  std::vector<WorldSlice> slices;
  const double n = aggregation.slices;
  for (int i = 0; i < aggregation.slices; ++i) slices.push_back({i / n, (i + 1) / n, true});
  return slices;
}

}  // namespace infrasim
