#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "infrasim/config/lidar_changes.h"
#include "infrasim/config/lidar_config.h"
#include "infrasim/core/geometry.h"
#include "infrasim/core/normal.h"
#include "infrasim/core/rng.h"
#include "infrasim/sensor/return_model.h"
#include "infrasim/sensor/scan_pattern.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

constexpr std::size_t kDraws = 200'000;

ReturnsConfig returns_up_to(double max_range_m) {
  ReturnsConfig config;
  config.max_range_m = max_range_m;
  return config;
}

EchoBatch echoes_at(double range, std::size_t n, float reflectance, float gain = 1) {
  EchoBatch echoes;
  echoes.resize(n);
  for (std::size_t i = 0; i < n; ++i)
    echoes.set(i, {static_cast<float>(range), -1, 0, reflectance, gain});
  return echoes;
}

/// Returns the result of `apply` for many equal echoes.
ReturnBatch returns(const ReturnsConfig& config, double range, float reflectance = 0.1F,
                    const WeatherConfig& weather = {}, std::size_t n = kDraws) {
  const ReturnModel model(config, weather);
  const Rng rng = Rng::of(1, "lidar").at(0);
  ReturnBatch out;
  const EchoBatch echoes = echoes_at(range, n, reflectance);
  model.apply(rng, 0, echoes, echoes.reflectance, {}, out);
  return out;
}

double kept(const ReturnsConfig& config, double range, float reflectance = 0.1F,
            const WeatherConfig& weather = {}) {
  return static_cast<double>(returns(config, range, reflectance, weather).echo.size()) / kDraws;
}

/// Returns five standard deviations of the share of kDraws samples that have a given probability.
double bound(double share) { return 5 * std::sqrt(share * (1 - share) / kDraws) + 1e-9; }

struct Moments {
  double mean = 0, deviation = 0;
};
Moments moments(const std::vector<float>& values) {
  double sum = 0, squares = 0;
  for (const float v : values) sum += v;
  const double mean = sum / static_cast<double>(values.size());
  for (const float v : values) squares += (v - mean) * (v - mean);
  return {mean, std::sqrt(squares / static_cast<double>(values.size()))};
}

// --- range limits -----------------------------------------------------------------------------

TEST(returns, of_every_hit_within_the_limits_are_kept_as_they_are) {
  ReturnsConfig config = returns_up_to(100);
  config.min_range_m = 2;
  for (const double range : {2.0, 50.0, 100.0}) {
    const ReturnBatch out = returns(config, range, 0.1F, {}, 100);
    ASSERT_EQ(out.echo.size(), 100U);
    EXPECT_EQ(out.range[7], static_cast<float>(range));
    EXPECT_EQ(out.echo[7], 7U);
  }
  EXPECT_EQ(kept(config, 1.999), 0);
  EXPECT_EQ(kept(config, 100.001), 0);
  EXPECT_EQ(kept(config, kInf), 0);
}

// --- CARLA's drop-off -------------------------------------------------------------------------

TEST(returns, of_every_hit_are_points_in_any_weather) {
  ReturnsConfig config = returns_up_to(500);
  config.detection.emplace().range_at_10_percent_m = 50;
  config.every_hit = true;
  const WeatherConfig fog{.visibility_m = 30};
  for (const double range : {1.0, 100.0, 499.0}) {
    const ReturnBatch all = returns(config, range, 0.05F, fog, 100);
    EXPECT_EQ(all.size(), 100U) << range;
    for (std::size_t i = 0; i < all.size(); ++i) {
      EXPECT_EQ(all.range[i], static_cast<float>(range));
      EXPECT_EQ(all.intensity[i], 0.05F);
    }
    const std::vector<bool> can =
        ReturnModel(config, fog)
            .can_return(echoes_at(range, 3, 0.05F), std::vector<std::uint16_t>(3));
    EXPECT_EQ(can, std::vector<bool>(3, true));
  }
  EXPECT_EQ(returns(config, 501, 0.05F, fog, 100).size(), 0U);
}

TEST(drop_off, keeps_the_shares_of_carla) {
  ReturnsConfig config = returns_up_to(300);
  config.drop_off.emplace();
  // The random loss keeps a share of 0.55. All remaining points are kept if the intensity I =
  // exp(-0.004 d) is above 0.8, which it is up to 55.8 m. At longer ranges, a share of 0.5 I + 0.6
  // of the remaining points is kept.
  for (const double range : {1.0, 30.0, 55.0, 57.0, 80.0, 100.0, 250.0}) {
    const double intensity = std::exp(-0.004 * range);
    const double wanted = 0.55 * (intensity > 0.8 ? 1 : 0.5 * intensity + 0.6);
    EXPECT_NEAR(kept(config, range), wanted, bound(wanted)) << range;
  }
}

TEST(drop_off, with_rates_of_0_keeps_everything) {
  ReturnsConfig config = returns_up_to(300);
  config.drop_off =
      DropOffConfig{.general_rate = 0, .intensity_limit = 0.8, .zero_intensity_rate = 0};
  EXPECT_EQ(kept(config, 250), 1);
}

TEST(drop_off, the_random_loss_and_the_loss_of_faint_points_are_independent) {
  ReturnsConfig config = returns_up_to(300);
  config.drop_off =
      DropOffConfig{.general_rate = 0.5, .intensity_limit = 0.8, .zero_intensity_rate = 1};
  const double wanted = 0.5 * std::exp(-0.004 * 173.3) / 0.8;
  EXPECT_NEAR(kept(config, 173.3), wanted, bound(wanted));
}

TEST(intensity, without_a_detection_model_falls_as_in_carla) {
  EXPECT_NEAR(returns(returns_up_to(300), 100, 0.1F, {}, 1).intensity.at(0), std::exp(-0.4), 1e-6);
}

// --- detection --------------------------------------------------------------------------------

ReturnsConfig detecting(double range_at_10_percent_m) {
  ReturnsConfig config = returns_up_to(1000);
  config.detection.emplace().range_at_10_percent_m = range_at_10_percent_m;
  return config;
}

/// Returns the share of the echoes of one ring that are detected.
double kept_in_ring(const ReturnModel& model, std::uint16_t ring, double range) {
  constexpr std::size_t kFew = 4000;
  const EchoBatch echoes = echoes_at(range, kFew, 0.1F);
  ReturnBatch out;
  model.apply(Rng::of(1, "lidar").at(0), 0, echoes, echoes.reflectance,
              std::vector<std::uint16_t>(kFew, ring), out);
  return static_cast<double>(out.size()) / kFew;
}

TEST(detection, of_a_10_percent_target_is_a_half_at_the_published_range_of_each_channel) {
  struct Rings {
    int first, last;  ///< channels, counted from 1
    double range_m;
  };
  const std::vector<Rings> ot128{{1, 1, 60},     {2, 6, 80},     {7, 24, 100},   {25, 32, 140},
                                 {33, 64, 200},  {65, 88, 140},  {89, 112, 100}, {113, 125, 80},
                                 {126, 126, 50}, {127, 127, 40}, {128, 128, 30}};
  const std::vector<Rings> xt32{{1, 8, 50}, {9, 23, 80}, {24, 32, 50}};
  for (const auto& [name, published] : {std::pair{"hesai_ot128", ot128}, {"hesai_xt32", xt32}}) {
    const LidarUnit unit =
        read_lidar(testing::configs() / "lidars" / (std::string(name) + ".yaml"), "datasheet")
            .units.front();
    constexpr int kFirstRing = 7;  // as in a bundle
    const std::vector<Channel> channels = channels_by_ring(*unit.pattern.spinning);
    const ReturnModel model(unit.returns, {}, channels, kFirstRing);
    for (const auto& [first, last, range_m] : published)
      for (int channel = first; channel <= last; ++channel) {
        const auto ring =
            static_cast<std::uint16_t>(kFirstRing + static_cast<int>(channels.size()) - channel);
        EXPECT_GT(kept_in_ring(model, ring, 0.98 * range_m), 0.5) << name << " " << channel;
        EXPECT_LT(kept_in_ring(model, ring, 1.02 * range_m), 0.5) << name << " " << channel;
      }
  }
}

TEST(returns, of_a_channel_begin_at_its_own_shortest_range) {
  ReturnsConfig config = detecting(100);
  config.min_range_m = 0.3;
  const std::vector<Channel> channels{{.elevation_deg = -1, .min_range_m = 1.4},
                                      {.elevation_deg = 1}};
  const ReturnModel model(config, {}, channels);
  EXPECT_EQ(kept_in_ring(model, 0, 1.3), 0);
  EXPECT_EQ(kept_in_ring(model, 0, 1.5), 1);
  EXPECT_EQ(kept_in_ring(model, 1, 1.3), 1);
  EXPECT_EQ(kept_in_ring(model, 1, 0.2), 0);
  config.detection.reset();  // as under the preset `equal`, all channels then have the same limits
  EXPECT_EQ(kept_in_ring(ReturnModel(config, {}, channels), 0, 1.3), 1);
}

TEST(detection, of_a_10_percent_target_at_its_range_is_a_half) {
  EXPECT_NEAR(kept(detecting(150), 150), 0.5, bound(0.5));
  EXPECT_GT(kept(detecting(150), 100), 0.999);
  EXPECT_LT(kept(detecting(150), 250), 0.01);
}

TEST(detection, reaches_as_the_fourth_root_of_reflectance_by_day) {
  const double range = 100 * std::sqrt(2);
  EXPECT_NEAR(kept(detecting(100), range, 0.4F), 0.5, bound(0.5) + 1e-4);
}

const WeatherConfig kNight{.sunlight_klux = 0};

TEST(detection, reaches_as_the_square_root_of_reflectance_at_night) {
  EXPECT_NEAR(kept(detecting(100), 200, 0.4F, kNight), 0.5, bound(0.5));
}

TEST(detection, hears_the_sun_on_all_that_the_detector_looks_at) {
  // The surroundings reflect 1.6 and quadruple the noise, so a target of 10 % is not detected.
  const ReturnModel model(detecting(100), {});
  const std::vector<float> bright(kDraws, 1.6F);
  ReturnBatch out;
  model.apply(Rng::of(1, "lidar").at(0), 0, echoes_at(50, kDraws, 0.1F), bright, {}, out);
  EXPECT_NEAR(static_cast<double>(out.echo.size()) / kDraws, 0.5, bound(0.5));
}

TEST(detection, falls_with_the_cosine_of_incidence) {
  const ReturnModel model(detecting(100), kNight);
  const EchoBatch echoes = echoes_at(100, kDraws, 0.2F, 0.5F);
  ReturnBatch out;
  model.apply(Rng::of(1, "lidar").at(0), 0, echoes, echoes.reflectance, {}, out);
  EXPECT_NEAR(static_cast<double>(out.echo.size()) / kDraws, 0.5, bound(0.5));
  EXPECT_NEAR(out.intensity.at(0), 0.1, 1e-6);
}

TEST(detection, falls_with_range) {
  double last = 1;
  for (double range = 60; range < 200; range += 20) {
    const double share = kept(detecting(100), range);
    EXPECT_LE(share, last) << range;
    last = share;
  }
}

TEST(detection, more_rain_sees_less_far) {
  double last = 1;
  for (const double rain : {0.0, 5.0, 20.0, 80.0}) {
    WeatherConfig weather;
    weather.rain_mm_per_h = rain;
    const double share = kept(detecting(150), 130, 0.1F, weather);
    EXPECT_LT(share, last) << rain << " mm/h";
    last = share;
  }
}

TEST(detection, denser_fog_sees_less_far) {
  double last = 1;
  for (const double visibility : {kInf, 5000.0, 2000.0, 1000.0}) {
    WeatherConfig weather;
    weather.visibility_m = visibility;
    const double share = kept(detecting(150), 130, 0.1F, weather);
    EXPECT_LT(share, last) << visibility << " m";
    last = share;
  }
}

TEST(detection, in_fog_is_weakened_by_koschmieders_law_both_ways) {
  // Over the distance of the visibility, fog reduces the light to 5 %. An echo passes this distance
  // twice and is weakened by a factor of 400.
  WeatherConfig fog = kNight;
  fog.visibility_m = 100;
  EXPECT_NEAR(kept(detecting(100), 100, 40.F, fog), 0.5, bound(0.5));
}

TEST(detection, in_rain_is_weakened_by_marshall_and_palmers_law_both_ways) {
  WeatherConfig rain = kNight;
  rain.rain_mm_per_h = 25;
  const double alpha = 3.65e-4 * std::pow(25, 0.63);
  const auto reflectance = static_cast<float>(0.1 * std::exp(2 * alpha * 100));
  EXPECT_NEAR(kept(detecting(100), 100, reflectance, rain), 0.5, bound(0.5) + 1e-3);
}

// --- range noise ------------------------------------------------------------------------------

TEST(range_noise, has_the_deviation_of_the_accuracy_and_no_bias) {
  ReturnsConfig config = returns_up_to(100);
  config.range_accuracy_m = 0.03;
  const Moments m = moments(returns(config, 50).range);
  EXPECT_NEAR(m.mean, 50, 5 * 0.03 / std::sqrt(kDraws));
  EXPECT_NEAR(m.deviation, 0.03, 5 * 0.03 / std::sqrt(2.0 * kDraws));
}

TEST(range_noise, falls_with_the_root_of_the_signal_from_that_of_the_threshold) {
  ReturnsConfig config = detecting(200);
  config.range_accuracy_m = 0.02;
  for (const double snr : {0.7, 1.0, 2.0, 4.0, 100.0, 400.0}) {
    const double wanted = 0.02 / std::sqrt(2 * std::max(1.0, snr));
    const auto noisy = returns(config, 200, static_cast<float>(0.1 * snr), kNight).range;
    // The rounding of a float at 200 m is 0.4 % of the smallest standard deviation here.
    const double n = static_cast<double>(noisy.size());
    ASSERT_GT(n, 1000);
    EXPECT_NEAR(moments(noisy).deviation, wanted, wanted * (5 / std::sqrt(2 * n) + 0.01)) << snr;
  }
}

TEST(range_noise, never_makes_a_range_negative) {
  ReturnsConfig config = returns_up_to(100);
  config.range_accuracy_m = 1;
  for (const float range : returns(config, 0.1).range) ASSERT_GE(range, 0);
}

// --- random samples ------------------------------------------------------------------------------

ReturnsConfig noisy() {
  ReturnsConfig config = detecting(100);
  config.range_accuracy_m = 0.03;
  config.drop_off.emplace();
  return config;
}

ReturnBatch some(const Rng& rng, std::uint64_t first, std::size_t n) {
  ReturnBatch out;
  const EchoBatch echoes = echoes_at(100, n, 0.1F);
  ReturnModel(noisy(), {}).apply(rng, first, echoes, echoes.reflectance, {}, out);
  return out;
}

TEST(draws, of_a_ray_do_not_depend_on_its_batch) {
  const Rng rng = Rng::of(1, "lidar").at(3);
  const ReturnBatch whole = some(rng, 0, 1000);
  ReturnBatch parts = some(rng, 0, 321);
  const ReturnBatch rest = some(rng, 321, 679);
  for (std::size_t i = 0; i < rest.echo.size(); ++i) {
    parts.echo.push_back(rest.echo[i] + 321);
    parts.range.push_back(rest.range[i]);
  }
  EXPECT_GT(whole.echo.size(), 100U);
  EXPECT_EQ(parts.echo, whole.echo);
  EXPECT_EQ(parts.range, whole.range);
}

TEST(draws, depend_on_seed_lidar_and_frame) {
  const auto rays = [](std::uint64_t seed, const char* name, int frame) {
    return some(Rng::of(seed, name).at(frame), 0, 1000).echo;
  };
  EXPECT_EQ(rays(1, "lidar", 3), rays(1, "lidar", 3));
  EXPECT_NE(rays(2, "lidar", 3), rays(1, "lidar", 3));
  EXPECT_NE(rays(1, "radil", 3), rays(1, "lidar", 3));
  EXPECT_NE(rays(1, "lidar", 4), rays(1, "lidar", 3));
}

TEST(draws, of_targets_that_can_not_be_seen_or_missed_change_nothing) {
  // The echoes have margins from -17 to 17, and some larger margins. For the largest margins no
  // random sample is used.
  ReturnsConfig config = returns_up_to(500);
  DetectionConfig& detection = config.detection.emplace();
  detection.range_at_10_percent_m = 100;
  detection.steepness = 20;
  const ReturnModel model(config, {});
  const Rng rng = Rng::of(9, "lidar").at(1);
  EchoBatch echoes = echoes_at(0, 4000, 0.1F);
  for (std::size_t i = 0; i < echoes.size(); ++i)
    echoes.range[i] = 60 + 0.05F * static_cast<float>(i);
  ReturnBatch out;
  model.apply(rng, 0, echoes, echoes.reflectance, {}, out);
  std::vector<std::uint32_t> wanted;
  for (std::size_t i = 0; i < echoes.size(); ++i) {
    const double ratio = std::pow(100 / echoes.range[i], 2);
    const double quantile = normal_quantile(rng.at(i).open_uniform(2));  // the sample kDetection
    if (quantile < 20 * (ratio - 1)) wanted.push_back(static_cast<std::uint32_t>(i));
  }
  EXPECT_EQ(out.echo, wanted);
}

// --- warnings of weather ------------------------------------------------------------------------

/// Returns the warnings of a run in this weather, for a LiDAR with one unit per entry of
/// `detecting`. The entry states whether the unit detects by received power.
std::vector<std::string> warnings_of(const WeatherConfig& weather,
                                     const std::vector<bool>& detecting) {
  LidarConfig lidar;
  lidar.name = "lidar";
  lidar.preset = "paper";
  lidar.units.resize(detecting.size());
  for (std::size_t i = 0; i < detecting.size(); ++i)
    if (detecting[i]) lidar.units[i].returns.detection.emplace();
  return weather_warnings(weather, {{lidar}});
}

TEST(weather_warnings, name_a_lidar_that_no_weather_changes_and_its_preset) {
  for (const WeatherConfig& weather :
       {WeatherConfig{.rain_mm_per_h = 5}, WeatherConfig{.visibility_m = 100}, kNight}) {
    const std::vector<std::string> lines = warnings_of(weather, {false});
    ASSERT_EQ(lines.size(), 1U);
    EXPECT_EQ(lines.front(),
              "lidar, preset paper: weather: no effect, because it affects only LiDARs with "
              "returns.detection, which the preset lacks");
    EXPECT_TRUE(warnings_of(weather, {true, true}).empty());
  }
}

TEST(weather_warnings, count_the_units_of_a_bundle_once) {
  const auto lines = warnings_of({.rain_mm_per_h = 5}, {true, false, false});
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_NE(lines.front().find("no effect on 2 of its 3 units"), std::string::npos);
}

TEST(weather_warnings, are_none_in_clear_air) { EXPECT_TRUE(warnings_of({}, {false}).empty()); }

}  // namespace
}  // namespace infrasim
