#include "infrasim/sensor/pattern_period.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "infrasim/config/scene_config.h"

namespace infrasim {

namespace {

constexpr int kLongestPeriod = static_cast<int>(kLongestScene_s / kShortestPeriod_s);

/// Appends the numbers of ray groups, and of turns of each moving part, per second. Each of these
/// rates, multiplied by a period of the pattern, is a whole number.
void add_rates(const PatternConfig& pattern, std::vector<double>& per_s) {
  if (pattern.spinning) {
    per_s.push_back(columns_per_s(*pattern.spinning) / columns_per_group(*pattern.spinning));
    per_s.push_back(pattern.spinning->rate_hz);
  } else if (pattern.prisms) {
    per_s.push_back(pattern.prisms->steps_per_s);
    for (const PrismConfig& prism : pattern.prisms->prisms) per_s.push_back(prism.rpm / 60);
  } else {
    const double rows = static_cast<double>(pattern.table->directions.size());
    per_s.push_back(pattern.table->rays_per_s);
    per_s.push_back(pattern.table->rays_per_s / rows);
  }
}

/// Returns the frame step nearest to `step` that selects all frames of a period. Of two equally
/// near steps, the larger one is returned.
std::int64_t step_beside(std::int64_t step, std::int64_t period) {
  for (std::int64_t off = 1;; ++off)
    for (const std::int64_t other : {step + off, step - off})
      if (other > 0 && std::gcd(other, period) == 1) return other;
}

}  // namespace

int pattern_period(const LidarConfig& lidar, int most) {
  // tolerance of numbers of turns or ray groups, far below a beam's width
  constexpr double kWhole = 1e-6;
  std::vector<double> per_s;
  for (const LidarUnit& unit : lidar.units) add_rates(unit.pattern, per_s);
  for (int frames = 1; frames <= most; ++frames) {
    const auto is_whole = [&](double rate) {
      const double count = rate * period_s(lidar) * frames;
      return std::abs(count - std::round(count)) <= kWhole;
    };
    if (std::ranges::all_of(per_s, is_whole)) return frames;
  }
  return 0;
}

std::vector<std::string> period_warnings(const std::vector<LidarConfig>& lidars, int first,
                                         int last, int step) {
  std::vector<std::string> lines;
  const int frames = (last - 1 - first) / step + 1;
  for (const LidarConfig& lidar : lidars) {
    const int period =
        step == 1 ? 0 : pattern_period(lidar, std::min(last - first, kLongestPeriod));
    const int common = std::gcd(period, step);
    if (period == 0 || common == 1 || frames <= period / common) continue;
    lines.push_back("pattern-period: " + lidar.name + ": --frames: expected a step without a " +
                    "factor in common with the pattern's period, such as " +
                    std::to_string(step_beside(step, period)) + ", got " + std::to_string(step) +
                    ", which shows " + std::to_string(period / common) + " of the pattern's " +
                    std::to_string(period) + " frames");
  }
  return lines;
}

}  // namespace infrasim
