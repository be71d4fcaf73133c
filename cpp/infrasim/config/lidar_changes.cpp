#include "infrasim/config/lidar_changes.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "infrasim/config/lidar_keys.h"
#include "infrasim/core/errors.h"

namespace infrasim {

namespace {

/// Returns the ratio a / b of two rates as a fraction in lowest terms; no value if its denominator
/// is above 1000.
std::optional<Fraction> ratio_of(double a, double b) {
  constexpr std::int64_t kMostParts = 1000;
  for (std::int64_t parts = 1; parts <= kMostParts; ++parts) {
    const double whole = a * static_cast<double>(parts) / b;
    if (std::abs(whole - std::round(whole)) < 1e-9 * whole)
      return Fraction{std::llround(whole), parts};
  }
  return std::nullopt;
}

/// Sets the turns per second of a spinning unit. The columns per second do not change, so the
/// columns per turn do.
void set_rate(SpinningConfig& spinning, double rate_hz) {
  if (spinning.cycle_us) {
    spinning.rate_hz = rate_hz;
    return;
  }
  const auto ratio = ratio_of(spinning.rate_hz, rate_hz);
  if (!ratio)
    throw ConfigError("rate_hz: expected a ratio of small whole numbers to the rate of " +
                      config::number_text(spinning.rate_hz) + " Hz, such as 20 to 10, got " +
                      config::number_text(rate_hz));
  std::optional<Fraction> columns = columns_per_turn(spinning);
  if (columns) {
    const std::int64_t numerator = columns->numerator * ratio->numerator;
    const std::int64_t denominator = columns->denominator * ratio->denominator;
    const std::int64_t common = std::gcd(numerator, denominator);
    columns = {numerator / common, denominator / common};
  }
  spinning.rate_hz = rate_hz;
  if (spinning.columns_per_turn)
    spinning.columns_per_turn = columns;
  else if (columns)  // from this step, columns_per_turn() finds the same fraction
    spinning.azimuth_step_deg =
        360.0 * static_cast<double>(columns->denominator) / static_cast<double>(columns->numerator);
  else
    *spinning.azimuth_step_deg /= ratio->value();
}

}  // namespace

LidarConfig with_rate(LidarConfig lidar, double rate_hz) {
  if (!(rate_hz >= 1 / kLongestPeriod_s && rate_hz <= 1 / kShortestPeriod_s))
    throw ConfigError("rate_hz: expected " + config::number_text(1 / kLongestPeriod_s) + " to " +
                      config::number_text(1 / kShortestPeriod_s) + ", got " +
                      config::number_text(rate_hz));
  for (LidarUnit& unit : lidar.units) {
    if (unit.pattern.spinning) set_rate(*unit.pattern.spinning, rate_hz);
    if (unit.pattern.prisms) unit.pattern.prisms->period_s = 1 / rate_hz;
    if (unit.pattern.table) unit.pattern.table->period_s = 1 / rate_hz;
  }
  return lidar;
}

bool set_law_exponent(LidarConfig& lidar, double exponent) {
  if (!(exponent >= kLeastExponent && exponent <= kMostExponent))
    throw ConfigError("law_exponent: expected " + config::number_text(kLeastExponent) + " to " +
                      config::number_text(kMostExponent) + ", got " +
                      config::number_text(exponent));
  bool changed = false;
  for (LidarUnit& unit : lidar.units)
    if (auto& detection = unit.returns.detection; detection && detection->further_ranges.empty()) {
      detection->law_exponent = exponent;
      changed = true;
    }
  return changed;
}

EchoMode echo_mode(const std::string& name) {
  const auto names = enum_names(EchoMode{});
  const auto found = std::ranges::find(names, name);
  if (found == names.end())
    throw ConfigError("echo: expected strongest, first, last or dual, got '" + name + "'");
  return static_cast<EchoMode>(found - names.begin());
}

void set_echo_mode(LidarConfig& lidar, EchoMode mode) {
  for (LidarUnit& unit : lidar.units) {
    if (!unit.returns.detection && mode != EchoMode::kStrongest)
      throw ConfigError("echo: expected strongest with preset " + lidar.preset + " of " +
                        lidar.name + ", got another mode; this preset has no returns.detection");
    EchoesConfig echoes = unit.returns.echoes.value_or(EchoesConfig{});
    echoes.mode = mode;
    if (const std::string unoffered = unoffered_mode(echoes); !unoffered.empty())
      throw ConfigError("echo: " + lidar.name + ": " + unoffered);
    unit.returns.echoes = echoes;
  }
}

}  // namespace infrasim
