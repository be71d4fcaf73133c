#include "infrasim/cli/frame_range.h"

#include <charconv>
#include <cstdio>

#include "infrasim/core/errors.h"

namespace infrasim::cli {

FrameRange parse_frames(const std::string& text) {
  FrameRange range;
  int used = 0;
  const auto whole = [&](int fields, int expected) {
    return fields == expected && used == static_cast<int>(text.size());
  };
  const bool valid =
      whole(std::sscanf(text.c_str(), "%9d:%9d%n", &range.first, &range.last, &used), 2) ||
      whole(std::sscanf(text.c_str(), "%9d:%9d:%9d%n", &range.first, &range.last, &range.step,
                        &used),
            3);
  if (!valid || range.first < 0 || range.last <= range.first || range.step < 1)
    throw ConfigError("--frames: found '" + text +
                      "', allowed A:B or A:B:STEP with 0 <= A < B and STEP from 1");
  return range;
}

std::uint64_t parse_seed(const std::string& text) {
  std::uint64_t seed = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seed);
  if (error != std::errc{} || end != text.data() + text.size())
    throw ConfigError("--seed: found '" + text + "', allowed a whole number from 0");
  return seed;
}

}  // namespace infrasim::cli
