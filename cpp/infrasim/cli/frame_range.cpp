#include "infrasim/cli/frame_range.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <vector>

#include "infrasim/core/errors.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim::cli {

namespace {

/// The whole text as a number; nothing else.
template <class T>
bool parse_whole(std::string_view text, T& value) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc{} && end == text.data() + text.size() && !text.empty();
}

}  // namespace

FrameRange parse_frames(const std::string& text, double duration_s) {
  std::vector<std::string_view> parts;
  std::string_view rest = text;
  for (std::size_t colon = rest.find(':'); colon != std::string_view::npos;
       colon = rest.find(':')) {
    parts.push_back(rest.substr(0, colon));
    rest.remove_prefix(colon + 1);
  }
  parts.push_back(rest);
  FrameRange range;
  const bool valid = (parts.size() == 2 || parts.size() == 3) &&
                     parse_whole(parts[0], range.first) && parse_whole(parts[1], range.last) &&
                     (parts.size() == 2 || parse_whole(parts[2], range.step));
  const auto frames = static_cast<int>(std::llround(duration_s / kFramePeriod));
  if (!valid || range.first < 0 || range.last <= range.first || range.step < 1 ||
      range.last > frames)
    throw ConfigError("--frames: found '" + text +
                      "', allowed A:B or A:B:STEP with 0 <= A < B <= " + std::to_string(frames) +
                      " and STEP from 1");
  return range;
}

std::uint64_t parse_seed(const std::string& text) {
  std::uint64_t seed = 0;
  if (!parse_whole(text, seed))
    throw ConfigError("--seed: found '" + text + "', allowed a whole number from 0");
  return seed;
}

}  // namespace infrasim::cli
