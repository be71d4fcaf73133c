#include "infrasim/core/aggregation.h"

#include <charconv>

namespace infrasim {

std::optional<Aggregation> parse_aggregation(std::string_view text) {
  if (text == "exact") return Aggregation{0};
  if (text == "instant") return Aggregation{1};
  constexpr std::string_view kPrefix = "slices:";
  if (!text.starts_with(kPrefix)) return std::nullopt;
  text.remove_prefix(kPrefix.size());
  int slices = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), slices);
  if (error != std::errc{} || end != text.data() + text.size() || slices < 1 || slices > 1000)
    return std::nullopt;
  return Aggregation{slices};
}

}  // namespace infrasim
