#include "infrasim/sensor/return_model.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "infrasim/core/classes.h"
#include "infrasim/core/math.h"
#include "infrasim/core/normal.h"
#include "infrasim/sensor/range_law.h"
#include "infrasim/sensor/reflectance.h"

namespace infrasim {

namespace {

constexpr float kCarlaAttenuation = 0.004F;  // CARLA's atmosphere_attenuation_rate, in 1/m

enum ReturnSample : unsigned { kLoss, kKeep, kDetection, kNoise, kSamples };

double extinction(const WeatherConfig& weather) {
  const double rain = 3.65e-4 * math::pow(weather.rain_mm_per_h, 0.63);
  return rain + math::log(20.0) / weather.visibility_m;
}

/// Upper limit of the absolute value of the normal quantile of any uniform sample.
constexpr double kCertain = 8.5;

/// Decides whether a target is detected, with probability Phi(margin), where Phi is the normal
/// distribution function. The target is detected if the normal quantile of its uniform sample is
/// below the margin. The quantile is computed only if the sample is close to the limit.
class Detector {
 public:
  Detector() {
    const auto phi = [](double x) { return math::erfc(-x / std::numbers::sqrt2) / 2; };
    for (std::size_t i = 0; i < kSteps; ++i) {
      const double margin = static_cast<double>(i) / kStepsPerUnit - kCertain;
      always_[i] = phi(margin - kSlack);
      never_[i] = phi(margin + kSlack);
    }
  }

  bool detects(double margin, const Rng& ray_rng, unsigned first_sample) const {
    if (margin <= -kCertain) return false;
    if (!(margin < kCertain)) return true;
    const double u = ray_rng.open_uniform(first_sample + kDetection);
    const auto step = static_cast<std::size_t>((margin + kCertain) * kStepsPerUnit);
    if (u < always_[step]) return true;
    if (u > never_[step + 1]) return false;
    return normal_quantile(u) < margin;
  }

 private:
  static constexpr double kSlack = 1e-5;  // larger than the error of normal_quantile
  static constexpr std::size_t kStepsPerUnit = 16;
  static constexpr std::size_t kSteps = static_cast<std::size_t>(2 * kCertain * kStepsPerUnit) + 2;
  /// for each step of the margin: a target with a smaller sample is always detected
  std::array<double, kSteps> always_{};
  /// for each step of the margin: a target with a larger sample is never detected
  std::array<double, kSteps> never_{};
};

}  // namespace

ReturnModel::ReturnModel(const ReturnsConfig& config, const WeatherConfig& weather,
                         std::span<const Channel> channels, int first_ring)
    : config_(config),
      echoes_(config.echoes.value_or(EchoesConfig{})),
      extinction_per_m_(extinction(weather)),
      first_ring_(first_ring) {
  limits_.min_range_m = static_cast<float>(config.min_range_m);
  if (!config.detection) return;
  const RangeLaw law = fit_range_law(*config.detection, config.max_range_m);
  limits_.signal_m2 = law.dark_range_m * law.dark_range_m / 0.1;
  sun_per_rho_ = weather.sunlight_klux / law.background_noise_crossover_klux / 0.1;
  day_exponent_ = law.day_exponent;
  const auto has_limits = [](const Channel& c) { return c.range_at_10_percent_m || c.min_range_m; };
  if (std::ranges::none_of(channels, has_limits)) return;
  // Each channel has the range law of the LiDAR, scaled to the channel's range on a 10 % target.
  const double published_m = config.detection->range_at_10_percent_m;
  for (const Channel& c : channels) {
    const double scale = c.range_at_10_percent_m.value_or(published_m) / published_m;
    by_ring_.push_back({limits_.signal_m2 * scale * scale,
                        static_cast<float>(c.min_range_m.value_or(config.min_range_m))});
    min_range_by_ring_m_.push_back(by_ring_.back().min_range_m);
  }
}

/// Returns whether an echo comes directly from a recorded surface, which has a reflectance of 1.
/// Behind a pane the reflectance is reduced, and the echo can be lost like any other echo.
bool ReturnModel::is_recorded(const EchoBatch& echoes, std::size_t i) const {
  return echoes.object[i] < 0 &&
         echoes.class_id[i] == static_cast<std::uint16_t>(Class::kRecorded) &&
         (!config_.detection || echoes.reflectance[i] >= 1);
}

bool ReturnModel::lost_at_random(const Rng& ray_rng, unsigned first_sample) const {
  return ray_rng.uniform(first_sample + kLoss) < config_.drop_off->general_rate;
}

bool ReturnModel::dropped_when_faint(const Rng& ray_rng, unsigned first_sample,
                                     double intensity) const {
  const DropOffConfig& d = *config_.drop_off;
  if (intensity > d.intensity_limit) return false;
  const double slope = d.zero_intensity_rate / d.intensity_limit;
  return ray_rng.uniform(first_sample + kKeep) >= slope * intensity + 1 - d.zero_intensity_rate;
}

/// Computes the strength of each echo: the signal-to-noise ratio if the LiDAR detects by received
/// power, otherwise CARLA's intensity.
void ReturnModel::strengths(const EchoBatch& echoes, const std::vector<float>& sunlit,
                            std::span<const std::uint16_t> rings, std::vector<double>& out) const {
  out.resize(echoes.size());
  const std::size_t n = echoes.size();
  if (!config_.detection) {
    for (std::size_t i = 0; i < n; ++i) out[i] = -kCarlaAttenuation * echoes.range[i];
    return math::exp_all(out);
  }
  const float* range = echoes.range.data();
  const float* reflectance = echoes.reflectance.data();
  const float* gain = echoes.gain.data();
  const float* lit = sunlit.data();
  const bool shot_noise = day_exponent_ == kLawExponent;
  for (std::size_t i = 0; i < n; ++i) {
    const double r = range[i], reflected = reflectance[i] * gain[i];
    const double noise = shot_noise ? std::sqrt(std::max(1.0, sun_per_rho_ * lit[i])) : 1.0;
    out[i] = limits_.signal_m2 * reflected / (r * r) / noise;
  }
  if (!shot_noise)
    for (std::size_t i = 0; i < n; ++i)
      out[i] /= noise_in_sun(sun_per_rho_ * double{lit[i]}, day_exponent_);
  if (has_channels())
    for (std::size_t i = 0; i < n; ++i) out[i] *= limits_of(rings[i]).signal_m2 / limits_.signal_m2;
  if (extinction_per_m_ > 0)
    for (std::size_t i = 0; i < n; ++i)
      out[i] *= math::exp(-2 * extinction_per_m_ * double{range[i]});
}

std::vector<bool> ReturnModel::can_return(const EchoBatch& echoes,
                                          std::span<const std::uint16_t> rings) const {
  std::vector<double> strength;
  strengths(echoes, echoes.reflectance, rings, strength);
  std::vector<bool> can(echoes.size());
  for (std::size_t i = 0; i < echoes.size(); ++i)
    can[i] = in_range(echoes.range[i], rings[i]) &&
             (!config_.detection || config_.every_hit || is_recorded(echoes, i) ||
              config_.detection->steepness * (strength[i] - 1) > -kCertain);
  return can;
}

void ReturnModel::apply(const Rng& rng, std::uint64_t first_ray, const EchoBatch& echoes,
                        const std::vector<float>& sunlit, std::span<const std::uint16_t> rings,
                        ReturnBatch& out, std::span<const std::uint32_t> number,
                        std::span<const std::uint8_t> rank) const {
  static const Detector detector;
  out.resize(echoes.size());
  strengths(echoes, sunlit, rings, out.strength);
  std::size_t n = 0;
  for (std::size_t i = 0; i < echoes.size(); ++i) {
    float range = echoes.range[i];
    if (!in_range(range, has_channels() ? rings[i] : std::uint16_t{0})) continue;
    const Rng ray_rng = rng.at(first_ray + (number.empty() ? i : number[i]));
    const unsigned first_sample = rank.empty() ? 0 : kSamples * rank[i];
    const bool recorded = is_recorded(echoes, i);
    if (config_.drop_off && !recorded && lost_at_random(ray_rng, first_sample)) continue;
    double intensity = out.strength[i], sigma = config_.range_accuracy_m;
    if (config_.detection) {
      const double ratio = out.strength[i], margin = config_.detection->steepness * (ratio - 1);
      if (!recorded && !config_.every_hit && !detector.detects(margin, ray_rng, first_sample))
        continue;
      intensity = echoes.reflectance[i] * echoes.gain[i];
      // A signal is detected if its sum with the noise reaches the threshold. A detected signal
      // with a ratio below 1 is therefore treated as a signal at the threshold.
      sigma /= std::sqrt(2 * std::max(1.0, ratio));
    }
    if (config_.drop_off && !recorded && dropped_when_faint(ray_rng, first_sample, intensity))
      continue;
    if (sigma > 0)
      range +=
          static_cast<float>(sigma * normal_quantile(ray_rng.open_uniform(first_sample + kNoise)));
    out.echo[n] = static_cast<std::uint32_t>(i);
    out.range[n] = std::max(0.0F, range);
    out.intensity[n++] = static_cast<float>(std::min(1.0, intensity));
  }
  out.resize(n);
}

std::vector<std::string> weather_warnings(const WeatherConfig& weather,
                                          std::span<const LidarConfig> lidars) {
  std::vector<std::string> lines;
  constexpr WeatherConfig kNone;
  if (weather.rain_mm_per_h == kNone.rain_mm_per_h && weather.visibility_m == kNone.visibility_m &&
      weather.sunlight_klux == kNone.sunlight_klux)
    return lines;
  for (const LidarConfig& lidar : lidars) {
    const auto blind = std::ranges::count_if(
        lidar.units, [](const LidarUnit& unit) { return !unit.returns.detection; });
    if (blind == 0) continue;
    const auto units = std::ssize(lidar.units);
    const std::string where = blind == units ? ""
                                             : " on " + std::to_string(blind) + " of its " +
                                                   std::to_string(units) + " units";
    lines.push_back(
        lidar.name + ", preset " + lidar.preset + ": weather: no effect" + where +
        ", because it affects only LiDARs with returns.detection, which the preset lacks");
  }
  return lines;
}

}  // namespace infrasim
