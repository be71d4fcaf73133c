#include "infrasim/sensor/range_law.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <vector>

#include "infrasim/core/math.h"

namespace infrasim {

namespace {

/// Relative errors of a range that have the same weight by day and at night. Vendors round ranges
/// to 10 m, and publish few ranges at night.
constexpr double kDayTolerance = 0.02, kNightTolerance = 0.04;
/// Candidates for the crossover: 100 klx times 10^(i / 100), i from -100 to 100.
constexpr int kSteps = 100;

double tolerance(const PublishedRange& pair) {
  return pair.sunlight_klux > 0 ? kDayTolerance : kNightTolerance;
}

/// Returns the logarithm of the ratio of the published range to the predicted range.
double error(const RangeLaw& law, const PublishedRange& pair) {
  return math::log(pair.range_m / law.range_m(pair.reflectance, pair.sunlight_klux));
}

/// Returns the dark range that fits the published ranges best for a given crossover. Ranges that
/// equal the device's maximum are not used.
double best_dark_range(double background_noise_crossover_klux,
                       const std::vector<PublishedRange>& pairs, double max_range_m) {
  const RangeLaw one{.dark_range_m = 1,
                     .background_noise_crossover_klux = background_noise_crossover_klux};
  double sum = 0, weights = 0;
  for (const PublishedRange& pair : pairs) {
    if (pair.range_m >= max_range_m && pairs.size() > 1) continue;
    const double weight = 1 / (tolerance(pair) * tolerance(pair));
    sum += weight * error(one, pair);
    weights += weight;
  }
  return weights > 0 ? math::exp(sum / weights) : pairs.front().range_m;
}

double misfit(const RangeLaw& law, const std::vector<PublishedRange>& pairs, double max_range_m) {
  double sum = 0;
  for (const PublishedRange& pair : pairs) {
    const double e = error(law, pair) / tolerance(pair);
    if (pair.range_m < max_range_m || e > 0) sum += e * e;
  }
  return sum;
}

}  // namespace

double RangeLaw::noise(double sunlit, double klux) const {
  return std::max(1.0, std::sqrt(sunlit / 0.1 * klux / background_noise_crossover_klux));
}

double RangeLaw::range_m(double reflectance, double klux) const {
  return dark_range_m * std::sqrt(reflectance / 0.1 / noise(reflectance, klux));
}

RangeLaw fit_range_law(const DetectionConfig& detection, double max_range_m) {
  const std::vector<PublishedRange> pairs = published_ranges(detection);
  RangeLaw best{};
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i <= 2 * kSteps; ++i) {
    const int step = i % 2 == 0 ? -i / 2 : (i + 1) / 2;  // 0, 1, -1, 2, -2, ...
    RangeLaw law{.dark_range_m = 0,
                 .background_noise_crossover_klux = math::pow(10, 2 + step / 100.0)};
    law.dark_range_m = best_dark_range(law.background_noise_crossover_klux, pairs, max_range_m);
    const double error = misfit(law, pairs, max_range_m);
    if (error < least - 1e-9) least = error, best = law;
  }
  return best;
}

LawRange worst_of_law(const DetectionConfig& detection, double max_range_m) {
  const RangeLaw law = fit_range_law(detection, max_range_m);
  LawRange worst;
  for (const PublishedRange& pair : published_ranges(detection)) {
    const double law_m = law.range_m(pair.reflectance, pair.sunlight_klux);
    const LawRange one{pair, std::min(law_m, std::max(max_range_m, pair.range_m))};
    if (worst.law_m == 0 || std::abs(one.error()) > std::abs(worst.error())) worst = one;
  }
  return worst;
}

}  // namespace infrasim
