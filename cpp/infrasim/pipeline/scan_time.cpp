#include "infrasim/pipeline/scan_time.h"

#include <algorithm>
#include <numeric>

namespace infrasim {

namespace {

double mean(std::span<const double> values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

}  // namespace

double scan_time_s(std::span<double> times_s, double cut_s) {
  const auto [first, last] = std::ranges::minmax(times_s);
  if (last - first <= cut_s) return mean(times_s);
  std::ranges::sort(times_s);
  std::size_t second = 0;  // index of the first time in the second group
  double pause = 0;
  for (std::size_t i = 1; i < times_s.size(); ++i)
    if (times_s[i] - times_s[i - 1] > pause) {
      pause = times_s[i] - times_s[i - 1];
      second = i;
    }
  if (pause <= cut_s) return mean(times_s);
  const bool first_is_larger = second >= times_s.size() - second;
  return mean(first_is_larger ? times_s.first(second) : times_s.subspan(second));
}

double cut_s(const LidarConfig& lidar) {
  const bool spins = std::ranges::any_of(
      lidar.units, [](const LidarUnit& unit) { return unit.pattern.spinning.has_value(); });
  return spins ? period_s(lidar) / 2 : kInf;
}

}  // namespace infrasim
