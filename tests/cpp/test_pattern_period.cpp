#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "infrasim/scene/trajectories.h"
#include "infrasim/sensor/pattern_period.h"
#include "infrasim/sensor/scan_pattern.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::five_directions;
using testing::shipped;

LidarConfig lidar_of(const std::vector<PatternConfig>& patterns) {
  LidarConfig lidar;
  lidar.name = "own";
  for (const PatternConfig& pattern : patterns) lidar.units.push_back({0, 0, pattern, {}});
  return lidar;
}

PatternConfig turning(double rate_hz, double step_deg) {
  PatternConfig pattern;
  SpinningConfig& spinning = pattern.spinning.emplace();
  spinning.rate_hz = rate_hz;
  spinning.azimuth_step_deg = step_deg;
  spinning.channels.table = {{0, 0, 0}};
  return pattern;
}

/// Returns the largest difference of direction or time between corresponding rays of two frames.
/// The frames must have equally many rays.
double difference(const LidarConfig& lidar, int frame, int other) {
  double most = 0;
  const double frame_s = period_s(lidar);
  for (const LidarUnit& unit : lidar.units) {
    const ScanPattern pattern(unit.pattern, 0.3, rotation(0, 0, 0), 0);
    const auto rays = [&](int k) { return pattern.fired_between(k * frame_s, (k + 1) * frame_s); };
    const RayRange a = rays(frame), b = rays(other);
    if (a.size() != b.size()) return INFINITY;
    for (std::int64_t i = 0; i < a.size(); ++i) {
      const Ray one = pattern.ray(a.first + i), two = pattern.ray(b.first + i);
      const double late = two.time_s - one.time_s - (other - frame) * frame_s;
      most = std::max({most, norm(two.direction - one.direction), std::abs(late)});
    }
  }
  return most;
}

TEST(pattern_period, is_the_first_after_which_frames_are_the_same) {
  std::vector<LidarConfig> lidars;
  for (const char* name :
       {"livox_avia", "livox_mid_40", "velodyne_hdl_64e", "helios_16", "hesai_ot128"})
    lidars.push_back(shipped(name, "equal"));
  lidars.push_back(lidar_of({five_directions()}));
  lidars.push_back(lidar_of({turning(5, 0.2)}));
  lidars.push_back(lidar_of({turning(10, 0.7)}));
  lidars.push_back(lidar_of({turning(10, 0.7), turning(10, 0.32)}));
  std::vector<int> periods;
  for (const LidarConfig& lidar : lidars) {
    const int period = periods.emplace_back(pattern_period(lidar, 1000));
    EXPECT_LT(difference(lidar, 3, 3 + period), 1e-7) << lidar.name;
    for (int factor = 2; factor <= period; ++factor) {
      if (period % factor != 0) continue;
      // The columns of the HDL-64E shift by a ninth of a column, 4e-4 rad, from turn to turn.
      EXPECT_GT(difference(lidar, 3, 3 + period / factor), 3e-4) << lidar.name << " " << factor;
    }
  }
  EXPECT_EQ(periods, (std::vector{200, 300, 9, 1, 1, 50, 1, 7, 7}));
}

TEST(pattern_period, of_a_bundle_is_that_of_all_its_units) {
  EXPECT_EQ(pattern_period(shipped("bundle_5_livox_avia", "equal"), 1000), 200);
  EXPECT_EQ(
      pattern_period(lidar_of({shipped("livox_avia", "equal").units[0].pattern, turning(10, 0.7)}),
                     2000),
      1400);
}

TEST(pattern_period, beyond_the_frames_is_none) {
  EXPECT_EQ(pattern_period(shipped("livox_avia", "equal"), 199), 0);
}

TEST(period_warnings, say_how_many_frames_of_the_pattern_a_step_shows) {
  const std::vector<LidarConfig> lidars{shipped("livox_avia", "equal"),
                                        shipped("helios_16", "equal")};
  const std::vector<std::string> lines = period_warnings(lidars, 0, 5000, 25);
  ASSERT_EQ(lines.size(), 1U);
  for (const char* word : {"livox_avia: ", "such as 27, got 25, ", "shows 8 of the pattern's 200 "})
    EXPECT_NE(lines[0].find(word), std::string::npos) << lines[0];
}

TEST(period_warnings, are_none_where_no_other_step_shows_more) {
  const std::vector<LidarConfig> avia{shipped("livox_avia", "equal")};
  EXPECT_TRUE(period_warnings(avia, 0, 5000, 1).empty());
  EXPECT_TRUE(period_warnings(avia, 0, 5000, 27).empty());
  EXPECT_TRUE(period_warnings(avia, 0, 200, 25).empty());
  EXPECT_FALSE(period_warnings(avia, 7, 208, 25).empty());
  // the pattern does not repeat within these frames
  EXPECT_TRUE(period_warnings(avia, 0, 190, 2).empty());
}

}  // namespace
}  // namespace infrasim
