#include "infrasim/sensor/range_law.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <vector>

#include "infrasim/core/math.h"

namespace infrasim {

namespace {

/// A relative error of `kDayTolerance` by day has the same weight in the fit as a relative error of
/// `kNightTolerance` at night. Vendors round ranges to 10 m, and publish few ranges at night.
constexpr double kDayTolerance = 0.02, kNightTolerance = 0.04;
/// Candidates for the crossover: 100 klx times 10^(i / 100), i from -100 to 100.
constexpr int kSteps = 100;
/// Maximum difference of two misfits that count as equally good.
constexpr double kEquallyGood = 1e-6;
/// Number of times that the interval of the best exponent is halved, down to about 1e-6.
constexpr int kHalvings = 20;

/// A published range, for one value of the crossover. The logarithm of the published range divided
/// by the law's range is `log_ratio + (0.5 - day_exponent) * log_sun` minus the logarithm of the
/// dark range.
struct Term {
  double log_ratio;
  double log_sun;  ///< logarithm of the sunlight relative to the crossover, at least 0
  double tolerance;
  /// whether the range equals the LiDAR's maximum range, and is thus only a lower limit
  bool at_maximum;

  double error(double exponent) const { return log_ratio + (0.5 - exponent) * log_sun; }
};

std::vector<Term> terms_of(const std::vector<PublishedRange>& pairs, double crossover_klux,
                           double max_range_m) {
  std::vector<Term> terms;
  for (const PublishedRange& pair : pairs) {
    const double relative = pair.reflectance / 0.1;
    const double sun = relative * pair.sunlight_klux / crossover_klux;
    terms.push_back({.log_ratio = math::log(pair.range_m / std::sqrt(relative)),
                     .log_sun = sun > 1 ? math::log(sun) : 0,
                     .tolerance = pair.sunlight_klux > 0 ? kDayTolerance : kNightTolerance,
                     .at_maximum = pair.range_m >= max_range_m});
  }
  return terms;
}

/// Returns the logarithm of the dark range that fits best for a given exponent. Ranges that equal
/// the LiDAR's maximum range are not used.
double best_log_dark_range(const std::vector<Term>& terms, double exponent) {
  double sum = 0, weights = 0;
  for (const Term& term : terms) {
    if (term.at_maximum && terms.size() > 1) continue;
    const double weight = 1 / (term.tolerance * term.tolerance);
    sum += weight * term.error(exponent);
    weights += weight;
  }
  return weights > 0 ? sum / weights : terms.front().error(exponent);
}

double misfit(const std::vector<Term>& terms, double exponent) {
  const double log_dark_range = best_log_dark_range(terms, exponent);
  double sum = 0;
  for (const Term& term : terms) {
    const double e = (term.error(exponent) - log_dark_range) / term.tolerance;
    if (!term.at_maximum || e > 0) sum += e * e;
  }
  return sum;
}

/// Returns the smallest of the exponents that fit best for a given crossover. The misfit is a
/// convex function of the exponent.
double best_exponent(const std::vector<Term>& terms) {
  double low = kLeastExponent, high = kMostExponent;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = (low + high) / 2, step = (high - low) * 1e-3;
    (misfit(terms, middle) <= misfit(terms, middle + step) ? high : low) = middle;
  }
  return misfit(terms, kLeastExponent) <= misfit(terms, high) + kEquallyGood ? kLeastExponent
                                                                             : high;
}

}  // namespace

double noise_in_sun(double sun, double day_exponent) {
  if (!(sun > 1)) return 1;
  return day_exponent == 0.25 ? std::sqrt(sun) : math::pow(sun, 1 - 2 * day_exponent);
}

double RangeLaw::noise(double sunlit, double klux) const {
  return noise_in_sun(sunlit / 0.1 * klux / background_noise_crossover_klux, day_exponent);
}

double RangeLaw::range_m(double reflectance, double klux) const {
  return dark_range_m * std::sqrt(reflectance / 0.1 / noise(reflectance, klux));
}

RangeLaw fit_range_law(const DetectionConfig& detection, double max_range_m) {
  const std::vector<PublishedRange> pairs = published_ranges(detection);
  RangeLaw best{};
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i <= 2 * kSteps && least > kEquallyGood; ++i) {
    const int step = i % 2 == 0 ? -i / 2 : (i + 1) / 2;  // in the order 0, 1, -1, 2, -2, ...
    const double crossover_klux = math::pow(10, 2 + step / 100.0);
    const std::vector<Term> terms = terms_of(pairs, crossover_klux, max_range_m);
    const double exponent =
        pairs.size() > 1 ? best_exponent(terms) : detection.law_exponent.value_or(kLawExponent);
    const double error = misfit(terms, exponent);
    if (error >= least - kEquallyGood) continue;
    least = error;
    best = {.dark_range_m = math::exp(best_log_dark_range(terms, exponent)),
            .background_noise_crossover_klux = crossover_klux,
            .day_exponent = exponent};
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
