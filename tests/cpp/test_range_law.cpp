#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/sensor/range_law.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

RangeLaw law_of(double range_at_10_percent_m, const std::vector<PublishedRange>& further,
                double max_range_m = 1000) {
  return fit_range_law({range_at_10_percent_m, further}, max_range_m);
}

TEST(range_law, of_one_published_range_goes_with_the_fourth_root_of_bright_targets_by_day) {
  const RangeLaw law = law_of(100, {});
  EXPECT_NEAR(law.range_m(0.1, 100), 100, 1e-9);
  EXPECT_NEAR(law.range_m(0.8, 100), 100 * std::pow(8, 0.25), 1e-9);
  // for a dark target, the noise of the detector dominates
  EXPECT_NEAR(law.range_m(0.025, 100), 50, 1e-9);
}

TEST(range_law, goes_with_the_square_root_of_reflectance_at_night) {
  const RangeLaw law = law_of(100, {});
  EXPECT_NEAR(law.range_m(0.4, 0), 200, 1e-9);
  EXPECT_NEAR(law.range_m(0.1, 0), 100, 1e-9);
}

TEST(range_law, finds_the_exponent_that_two_published_ranges_have) {
  for (const double exponent : {0.25, 0.3, 0.375, 0.42, 0.5}) {
    const double range_m = 100 * std::pow(8, exponent);
    const RangeLaw law = law_of(100, {{.range_m = range_m, .reflectance = 0.8}});
    EXPECT_EQ(law.background_noise_crossover_klux, 100);
    EXPECT_NEAR(law.day_exponent, exponent, 1e-4);
    EXPECT_NEAR(law.range_m(0.8, 100), range_m, 1e-3 * range_m);
    EXPECT_NEAR(law.range_m(0.4, 0), 2 * law.range_m(0.1, 0), 1e-9) << "at night";
  }
}

TEST(range_law, of_one_published_range_has_the_chosen_exponent_in_full_sun) {
  for (const double exponent : {0.25, 0.375, 0.5}) {
    const RangeLaw law = fit_range_law(
        {.range_at_10_percent_m = 100, .further_ranges = {}, .law_exponent = exponent}, 1000);
    EXPECT_NEAR(law.range_m(0.1, 100), 100, 1e-9);
    EXPECT_NEAR(law.range_m(0.8, 100), 100 * std::pow(8, exponent), 1e-9);
    EXPECT_NEAR(law.range_m(0.8, 0), 100 * std::sqrt(8), 1e-9);
    EXPECT_GE(law.range_m(0.8, 10), law.range_m(0.8, 100));
  }
}

TEST(range_law, of_a_fitted_lidar_falls_with_sunlight_and_grows_with_reflectance) {
  for (const double exponent : {0.25, 0.3, 0.5}) {
    const RangeLaw law{
        .dark_range_m = 100, .background_noise_crossover_klux = 80, .day_exponent = exponent};
    for (double rho = 0.02; rho < 1; rho *= 1.3)
      for (double klux = 0; klux < 150; klux += 10) {
        EXPECT_GT(law.range_m(1.1 * rho, klux), law.range_m(rho, klux));
        EXPECT_LE(law.range_m(rho, klux + 10), law.range_m(rho, klux) * (1 + 1e-12));
      }
  }
}

TEST(range_law, of_livox_mid_has_the_square_root_and_of_the_hdl_64e_the_power_0_42) {
  const auto exponent = [](const char* name) {
    const auto file = testing::configs() / "lidars" / (std::string(name) + ".yaml");
    const ReturnsConfig returns = read_lidar(file, "datasheet").units.front().returns;
    return fit_range_law(*returns.detection, returns.max_range_m).day_exponent;
  };
  EXPECT_EQ(exponent("livox_mid_40"), 0.5);
  EXPECT_EQ(exponent("livox_mid_70"), 0.5);
  EXPECT_EQ(exponent("livox_horizon"), 0.5);
  EXPECT_EQ(exponent("livox_avia"), 0.25);
  EXPECT_NEAR(exponent("velodyne_hdl_64e"), 0.421, 1e-3);
  EXPECT_NEAR(exponent("livox_tele_15"), 0.277, 1e-3);
}

TEST(range_law, of_a_lidar_that_the_sun_blinds_sees_farther_at_night) {
  const RangeLaw law = law_of(100, {{.range_m = 140, .reflectance = 0.1, .sunlight_klux = 0}});
  EXPECT_NEAR(law.range_m(0.1, 100), 100, 1);
  EXPECT_NEAR(law.range_m(0.1, 0), 140, 1.4);
}

TEST(range_law, takes_the_end_of_the_scale_for_a_range_that_it_must_reach) {
  const RangeLaw law = law_of(50, {{.range_m = 120, .reflectance = 0.8}}, 120);
  EXPECT_GE(law.range_m(0.8, 100), 119);
  EXPECT_NEAR(law.range_m(0.1, 100), 50, 0.5);
}

TEST(range_law, says_which_range_it_misses_most) {
  const DetectionConfig one{.range_at_10_percent_m = 100, .further_ranges = {}};
  EXPECT_NEAR(worst_of_law(one, 1000).error(), 0, 1e-9);
  // By day, the range grows at least with the fourth root of the reflectance: 150 m become 252 m at
  // 80 %.
  const DetectionConfig flat{.range_at_10_percent_m = 150,
                             .further_ranges = {{.range_m = 200, .reflectance = 0.8}}};
  const double off = std::pow(8, 0.25) * 150 / 200;
  EXPECT_NEAR(std::abs(worst_of_law(flat, 1000).error()), std::sqrt(off) - 1, 0.02);
  EXPECT_NEAR(worst_of_law(flat, 200).error(), 0, 1e-9);  // equals the device's maximum range
}

TEST(range_law, holds_every_published_range_of_the_catalogue) {
  std::size_t pairs = 0, lidars = 0;
  for (const auto& entry : std::filesystem::directory_iterator(testing::configs() / "lidars")) {
    if (entry.path().extension() != ".yaml") continue;
    const LidarConfig lidar = read_lidar(entry.path(), "datasheet");
    const ReturnsConfig& returns = lidar.units.front().returns;
    const RangeLaw law = fit_range_law(*returns.detection, returns.max_range_m);
    std::vector<PublishedRange> all{{.range_m = returns.detection->range_at_10_percent_m}};
    for (const PublishedRange& further : returns.detection->further_ranges) all.push_back(further);
    ++lidars;
    for (const PublishedRange& pair : all) {
      const double range_m =
          std::min(returns.max_range_m, law.range_m(pair.reflectance, pair.sunlight_klux));
      const double tolerance = pair.sunlight_klux > 0 ? 0.02 : 0.04;
      EXPECT_NEAR(range_m, pair.range_m, tolerance * pair.range_m)
          << lidar.name << " at " << pair.reflectance << ", " << pair.sunlight_klux << " klx";
      ++pairs;
    }
  }
  EXPECT_EQ(lidars, 15U);
  EXPECT_GE(pairs, 33U);
}

}  // namespace
}  // namespace infrasim
