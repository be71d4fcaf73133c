#include "infrasim/cli/arguments.h"

#include <vector>

#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/core/numbers.h"

namespace infrasim::cli {

namespace {

bool parse_whole(std::string_view text, int& value) {
  const auto number = parse_number<int>(text);
  value = number.value_or(0);
  return number.has_value();
}

}  // namespace

FrameRange parse_frames(const std::string& text, int frames, const std::string& reason) {
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
  if (!valid || range.first < 0 || range.last <= range.first || range.step < 1 ||
      range.last > frames)
    throw ConfigError(
        "--frames: expected A:B or A:B:STEP with 0 <= A < B <= " + std::to_string(frames) +
        (reason.empty() ? "" : " (" + reason + ")") + " and STEP >= 1, got '" + text + "'");
  return range;
}

std::uint64_t parse_seed(const std::string& text) {
  const auto seed = parse_number<std::uint64_t>(text);
  if (!seed) throw ConfigError("--seed: expected a whole number of 0 or more, got '" + text + "'");
  return *seed;
}

void refuse_input(const char* option, const std::filesystem::path& file) {
  if (was_read(file))
    throw ConfigError(std::string(option) + ": expected another file than the inputs, got " +
                      file.string());
}

}  // namespace infrasim::cli
