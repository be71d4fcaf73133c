#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <numeric>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/config/lidar_tables.h"
#include "infrasim/core/geometry.h"
#include "infrasim/scene/trajectories.h"
#include "infrasim/sensor/field_of_view.h"
#include "infrasim/sensor/pattern_table.h"
#include "infrasim/sensor/scan_pattern.h"
#include "small_scenes.h"

namespace infrasim {
namespace {

using testing::configs;
using testing::five_directions;
using testing::shipped;
using testing::spinning;

const Mat3 kLevel = rotation(0, 0, 0);

/// Returns a pattern of 16 lines, 2 degrees apart, fired one after the other in the order -15, 1,
/// -13, 3, ...
PatternConfig vlp16() {
  SpinningConfig s;
  s.rate_hz = 10;
  s.cut_angle_deg = 0;
  s.azimuth_step_deg = 0.2;
  s.channels.table = config::read_channels(configs() / "lidars/channels/velodyne_vlp16.csv");
  for (std::size_t i = 0; i < s.channels.table.size(); ++i)
    s.channels.table[i].fire_time_us = 2.304 * static_cast<double>(i);
  PatternConfig pattern;
  pattern.spinning = s;
  return pattern;
}

PatternConfig avia() {
  return read_lidar(configs() / "lidars/livox_avia.yaml", "paper").units.front().pattern;
}

/// Returns a pattern of 16 lines, of which some fire in every second, third or sixth column.
PatternConfig alternating() {
  PatternConfig pattern = vlp16();
  std::vector<Channel>& channels = pattern.spinning->channels.table;
  channels[1].column_step = 2;
  channels[4].column_step = 3, channels[4].first_column = 2;
  channels[5].column_step = 6, channels[5].first_column = 5;
  return pattern;
}

/// Returns the pattern of five_directions with unevenly spaced times.
PatternConfig five_directions_in_bursts() {
  PatternConfig pattern = five_directions();
  pattern.table->times_s = {0, 0.0001, 0.0001, 0.0032, 0.0041};
  return pattern;
}

RayRange frame(const ScanPattern& pattern, int k) {
  return pattern.fired_between(k * kUsualPeriod_s, (k + 1) * kUsualPeriod_s);
}

RayBatch rays_of(const ScanPattern& pattern, int k) {
  RayBatch rays;
  pattern.generate(frame(pattern, k), k * kUsualPeriod_s, rays);
  return rays;
}

double azimuth(const RayBatch& rays, std::size_t i) { return std::atan2(rays.dy[i], rays.dx[i]); }
double elevation(const RayBatch& rays, std::size_t i) {
  return std::atan2(rays.dz[i], std::hypot(rays.dx[i], rays.dy[i]));
}

/// A pattern with a name for messages.
struct Named {
  std::string name;
  ScanPattern pattern;
};
/// Returns patterns of every kind, some of them with motors that have run for some time.
std::vector<Named> all_patterns() {
  const Mat3 pose = rotation(0.4, -0.2, 0.1);
  PatternConfig uneven = spinning(5, -10, 10, 0.17);
  uneven.spinning->rate_hz = 7;
  return {{"vlp16", ScanPattern(vlp16(), 0, kLevel, 0)},
          {"vlp16 turned", ScanPattern(vlp16(), 512.3456, pose, 0)},
          {"uneven", ScanPattern(uneven, 77.7, pose, 0)},
          {"alternating", ScanPattern(alternating(), 77.7, pose, 0)},
          {"avia", ScanPattern(avia(), 0, kLevel, 0)},
          {"avia turned", ScanPattern(avia(), 512.3456, pose, 0)},
          {"table", ScanPattern(five_directions(), 0.0123, pose, 0)},
          {"table in bursts", ScanPattern(five_directions_in_bursts(), 0.0123, pose, 0)}};
}

// --- spinning ---------------------------------------------------------------------------------

TEST(spinning_pattern, fires_every_line_at_every_azimuth_step_of_a_turn) {
  const ScanPattern pattern(vlp16(), 0, kLevel, 0);
  EXPECT_EQ(pattern.group_size(), 16);
  EXPECT_EQ(pattern.groups_per_s(), 18000);
  for (const int k : {0, 7, 4999}) EXPECT_EQ(frame(pattern, k).size(), 16 * 1800) << k;
}

TEST(spinning_pattern, ring_0_is_the_lowest_line) {
  const ScanPattern pattern(vlp16(), 0, kLevel, 0);
  const RayBatch rays = rays_of(pattern, 0);
  for (std::size_t i = 0; i < 16; ++i)
    EXPECT_NEAR(deg(elevation(rays, i)), -15 + 2 * rays.ring[i], 1e-4);
}

TEST(spinning_pattern, rings_start_at_the_first_ring_of_the_unit) {
  const ScanPattern pattern(vlp16(), 0, kLevel, 64);
  const RayBatch rays = rays_of(pattern, 0);
  EXPECT_EQ(*std::ranges::min_element(rays.ring), 64);
  EXPECT_EQ(*std::ranges::max_element(rays.ring), 79);
}

TEST(spinning_pattern, turns_clockwise_by_the_azimuth_step_from_column_to_column) {
  const RayBatch rays = rays_of(ScanPattern(vlp16(), 0, kLevel, 0), 0);
  EXPECT_NEAR(azimuth(rays, 0), 0, 1e-6);
  for (std::size_t i = 16; i < rays.size(); ++i)
    ASSERT_NEAR(wrap_angle(azimuth(rays, i) - azimuth(rays, i - 16)), -rad(0.2), 1e-5);
}

TEST(spinning_pattern, later_channels_of_a_column_fire_later_and_look_further_round) {
  const RayBatch rays = rays_of(ScanPattern(vlp16(), 0, kLevel, 0), 0);
  for (std::size_t i = 0; i < 32; ++i) {
    const std::size_t column = i / 16, channel = i % 16;
    const double since =
        static_cast<double>(column) / 18000 + static_cast<double>(channel) * 2.304e-6;
    EXPECT_NEAR(rays.time[i], since, 1e-8);
    EXPECT_NEAR(azimuth(rays, i), -2 * kPi * 10 * since, 1e-5);
  }
}

TEST(spinning_pattern, azimuth_offsets_are_in_the_sense_of_rotation) {
  PatternConfig config = spinning(2, -1, 1, 0.2);
  config.spinning->channels.table[1].azimuth_offset_deg = 5;
  const RayBatch rays = rays_of(ScanPattern(config, 0, kLevel, 0), 0);
  EXPECT_NEAR(deg(azimuth(rays, 0)), 0, 1e-4);
  EXPECT_NEAR(deg(azimuth(rays, 1)), -5, 1e-4);
}

TEST(spinning_pattern, a_channel_with_a_column_step_has_every_so_many_rays_of_one_without) {
  const ScanPattern full(vlp16(), 0.012, kLevel, 0), some(alternating(), 0.012, kLevel, 0);
  EXPECT_EQ(some.rings(), 16);
  EXPECT_EQ(some.group_size(), 13 * 6 + 3 + 2 + 1);
  for (const int k : {0, 3, 4999}) {
    const RayBatch all = rays_of(full, k), rays = rays_of(some, k);
    std::vector<int> steps(16, 1);
    const PatternConfig config = alternating();
    for (const Channel& c : config.spinning->channels.table)
      steps[static_cast<std::size_t>((c.elevation_deg + 15) / 2)] = c.column_step;
    for (int ring = 0; ring < 16; ++ring) {
      // rays of the ring in both patterns, in the order of time
      std::vector<std::size_t> of_all, of_some;
      for (std::size_t i = 0; i < all.size(); ++i)
        if (all.ring[i] == ring) of_all.push_back(i);
      for (std::size_t i = 0; i < rays.size(); ++i)
        if (rays.ring[i] == ring) of_some.push_back(i);
      const std::size_t step = static_cast<std::size_t>(steps[static_cast<std::size_t>(ring)]);
      ASSERT_EQ(of_some.size() * step, of_all.size()) << ring;
      const std::size_t first = step == 3 ? 2 : step == 6 ? 5 : 0;
      for (std::size_t i = 0; i < of_some.size(); ++i) {
        const std::size_t a = of_some[i], b = of_all[i * step + first];
        ASSERT_NEAR(rays.dx[a], all.dx[b], 1e-6);
        ASSERT_NEAR(rays.dy[a], all.dy[b], 1e-6);
        ASSERT_NEAR(rays.dz[a], all.dz[b], 1e-6);
        ASSERT_NEAR(rays.time[a], all.time[b], 1e-7);
      }
    }
  }
}

TEST(spinning_pattern, a_phase_is_a_turn_that_has_been_made) {
  const RayBatch rays = rays_of(ScanPattern(vlp16(), 0.025, kLevel, 0), 0);
  EXPECT_NEAR(deg(azimuth(rays, 0)), -90, 1e-4);
  EXPECT_EQ(rays.time[0], 0);
}

// --- any pattern ------------------------------------------------------------------------------

TEST(spinning_pattern, columns_per_turn_give_the_directions_of_their_step) {
  for (const auto& [columns, step_deg] :
       {std::pair{Fraction{1800, 1}, 0.2}, std::pair{Fraction{8125, 4}, 360 * 4 / 8125.0}}) {
    PatternConfig by_step = vlp16(), by_columns = vlp16();
    by_step.spinning->azimuth_step_deg = step_deg;
    by_columns.spinning->azimuth_step_deg.reset();
    by_columns.spinning->columns_per_turn = columns;
    const ScanPattern a(by_step, 12.3, kLevel, 0), b(by_columns, 12.3, kLevel, 0);
    for (const int k : {0, 1, 7, 4999}) {
      ASSERT_EQ(frame(a, k).first, frame(b, k).first);
      ASSERT_EQ(frame(a, k).last, frame(b, k).last);
      for (std::int64_t i = frame(a, k).first; i < frame(a, k).last; i += 37) {
        const double angle = norm(a.ray(i).direction - b.ray(i).direction);
        ASSERT_LT(deg(angle), 1e-6) << k << " " << i;
        ASSERT_NEAR(a.ray(i).time_s, b.ray(i).time_s, 1e-9);
      }
    }
  }
}

TEST(spinning_pattern, of_a_fraction_repeats_after_as_many_turns_as_its_denominator) {
  PatternConfig config = spinning(1, 0, 0, 0.2);
  config.spinning->azimuth_step_deg.reset();
  config.spinning->columns_per_turn = Fraction{8125, 4};
  const ScanPattern pattern(config, 0, kLevel, 0);
  for (const std::int64_t column : {0, 1, 2031, 2032, 8124}) {
    const Vec3 d = pattern.ray(column).direction;
    EXPECT_EQ(pattern.ray(column + 8125LL * 1'000'000).direction.x, d.x);
    EXPECT_EQ(pattern.ray(column + 8125LL * 1'000'000).direction.y, d.y);
  }
  EXPECT_NE(pattern.ray(8125 / 4).direction.y, pattern.ray(0).direction.y);
}

PatternConfig in_columns(Fraction columns_per_turn) {
  PatternConfig config = vlp16();
  config.spinning->azimuth_step_deg.reset();
  config.spinning->columns_per_turn = columns_per_turn;
  return config;
}

TEST(scan_pattern, repeats_its_directions_bit_for_bit_after_as_many_groups_as_it_says) {
  const Mat3 pose = rotation(0.4, -0.2, 0.1);
  for (const auto& [config, repeats] :
       {std::pair{in_columns({1800, 1}), 1800}, std::pair{in_columns({8125, 4}), 8125},
        std::pair{alternating(), 300}, std::pair{five_directions(), 5},
        std::pair{spinning(3, -9, 1, 0.2), 1800}, std::pair{spinning(3, -9, 1, 0.7), 3600},
        std::pair{spinning(3, -9, 1, 0.3515625), 1024}}) {
    SCOPED_TRACE(repeats);
    const ScanPattern pattern(config, 512.3456, pose, 0);
    ASSERT_EQ(pattern.repeats_after(), repeats);
    const std::int64_t rays = repeats * pattern.group_size();
    RayBatch first, later;
    pattern.generate({0, rays}, 0, first);
    for (const std::int64_t turns : {1, 7, 4999}) {
      pattern.generate({turns * rays, (turns + 1) * rays}, 0, later);
      EXPECT_TRUE(first.dx == later.dx && first.dy == later.dy && first.dz == later.dz) << turns;
    }
  }
}

TEST(scan_pattern, of_prisms_or_of_a_step_that_no_short_fraction_gives_never_repeats) {
  EXPECT_EQ(ScanPattern(avia(), 0, kLevel, 0).repeats_after(), 0);
  for (const double step_deg : {0.2001, 0.20000000000001, std::sqrt(0.1), kPi})
    EXPECT_EQ(ScanPattern(spinning(3, -9, 1, step_deg), 0, kLevel, 0).repeats_after(), 0)
        << step_deg;
}

TEST(spinning_pattern, a_step_has_the_directions_of_its_columns_bit_for_bit) {
  for (const auto& [columns, step_deg] :
       {std::pair{Fraction{1800, 1}, 0.2}, std::pair{Fraction{3600, 7}, 0.7},
        std::pair{Fraction{8125, 4}, 360 * 4 / 8125.0}, std::pair{Fraction{1440, 1}, 0.25}}) {
    PatternConfig by_step = vlp16();
    by_step.spinning->azimuth_step_deg = step_deg;
    const ScanPattern a(by_step, 12.3, kLevel, 0), b(in_columns(columns), 12.3, kLevel, 0);
    RayBatch left, right;
    for (const int k : {0, 7, 35999}) {
      a.generate(frame(a, k), k * 0.1, left);
      b.generate(frame(a, k), k * 0.1, right);
      EXPECT_TRUE(left.dx == right.dx && left.dy == right.dy && left.dz == right.dz) << step_deg;
      EXPECT_EQ(left.time, right.time);
    }
  }
}

TEST(spinning_pattern, a_step_of_few_binary_digits_looks_where_a_product_of_it_does) {
  PatternConfig config = spinning(1, 0, 0, 0.25);
  const ScanPattern pattern(config, 0, kLevel, 0);
  for (const std::int64_t column : {1, 1439, 1441, 500'000'123}) {
    const double azimuth = -rad(std::fmod(0.25 * static_cast<double>(column), 360));
    EXPECT_EQ(pattern.ray(column).direction.x, std::cos(azimuth));
    EXPECT_EQ(pattern.ray(column).direction.y, std::sin(azimuth));
  }
}

TEST(scan_pattern, of_every_spinning_lidar_that_ships_repeats) {
  int spinning_units = 0;
  for (const auto& entry : std::filesystem::directory_iterator(configs() / "lidars")) {
    if (entry.path().extension() != ".yaml") continue;
    for (const LidarUnit& unit : read_lidar(entry.path(), "datasheet").units) {
      if (!unit.pattern.spinning) continue;
      ++spinning_units;
      EXPECT_GT(ScanPattern(unit.pattern, 0, kLevel, 0).repeats_after(), 0) << entry.path();
    }
  }
  EXPECT_EQ(spinning_units, 9);
}

TEST(catalogue, lidars_have_the_columns_of_their_firing_cycle) {
  struct Cycle {
    std::string name;
    double cycle_us;
    Fraction columns;  ///< per turn at 10 Hz
  };
  for (const auto& [name, cycle_us, columns] :
       std::vector<Cycle>{{"velodyne_vlp_16", 55.296, {390625, 216}},
                          {"velodyne_vlp_32c", 55.296, {390625, 216}},
                          {"velodyne_hdl_64e", 57.6, {15625, 9}},
                          {"velodyne_vls_128", 53.3, {1876, 1}},
                          {"hesai_xt32", 50, {2000, 1}},
                          {"hesai_ot128", 27.778, {3600, 1}},
                          {"pandar_64", 55.556, {1800, 1}},
                          {"ruby_plus", 55.556, {1800, 1}},
                          {"helios_16", 55.556, {1800, 1}}}) {
    SCOPED_TRACE(name);
    const SpinningConfig spinning = *shipped(name).units.front().pattern.spinning;
    const auto per_turn = columns_per_turn(spinning);
    EXPECT_EQ(per_turn->numerator, columns.numerator);
    EXPECT_EQ(per_turn->denominator, columns.denominator);
    EXPECT_NEAR(1e6 / columns_per_s(spinning), cycle_us, 0.006);
  }
}

TEST(catalogue, channels_fire_one_after_the_other_within_their_cycle) {
  struct Times {
    std::string name;
    double step_us, last_us;  ///< difference of consecutive fire times, and the last fire time
  };
  for (const auto& [name, step_us, last_us] : std::vector<Times>{{"velodyne_vlp_16", 2.304, 34.56},
                                                                 {"velodyne_vlp_32c", 2.304, 34.56},
                                                                 {"velodyne_vls_128", 2.665, 42.64},
                                                                 {"hesai_xt32", 1.512, 47.152}}) {
    SCOPED_TRACE(name);
    const SpinningConfig spinning = *shipped(name).units.front().pattern.spinning;
    const std::vector<Channel>& channels = spinning.channels.table;
    EXPECT_NEAR(channels.back().fire_time_us, last_us, 1e-9);
    EXPECT_LT(channels.back().fire_time_us, 1e6 / columns_per_s(spinning));
    for (std::size_t i = 1; i < channels.size(); ++i) {
      const double steps = (channels[i].fire_time_us - channels[i - 1].fire_time_us) / step_us;
      EXPECT_NEAR(steps, std::round(steps), 1e-6) << i;
      EXPECT_TRUE(steps > -1e-6 && steps < 2.001) << i;
    }
  }
  // The two blocks of the HDL-64E fire at the same time.
  const PatternConfig config = shipped("velodyne_hdl_64e").units.front().pattern;
  const std::vector<Channel>& hdl = config.spinning->channels.table;
  for (std::size_t i = 0; i < 32; ++i) {
    EXPECT_EQ(hdl[i].fire_time_us, hdl[i + 32].fire_time_us);
    if (i > 0) {
      EXPECT_GT(hdl[i].fire_time_us, hdl[i - 1].fire_time_us);
    }
  }
}

TEST(catalogue, the_ot128_has_3600_rays_per_turn_in_channels_25_to_88_and_1800_in_the_others) {
  const PatternConfig config = shipped("hesai_ot128").units.front().pattern;
  const ScanPattern pattern(config, 0, kLevel, 0);
  EXPECT_EQ(pattern.rings(), 128);
  EXPECT_NEAR(rays_per_s(config), 3'456'000, 1e-6);
  for (const int k : {0, 4999}) {
    const RayBatch rays = rays_of(pattern, k);
    ASSERT_EQ(rays.size(), 345'600U);
    std::vector<std::vector<double>> azimuths(128);
    for (std::size_t i = 0; i < rays.size(); ++i)
      azimuths[rays.ring[i]].push_back(deg(azimuth(rays, i)));
    for (std::size_t ring = 0; ring < 128; ++ring) {
      const std::size_t channel = 128 - ring;  // channel 1 is the highest
      const bool dense = channel >= 25 && channel <= 88;
      ASSERT_EQ(azimuths[ring].size(), dense ? 3600U : 1800U) << channel;
      std::ranges::sort(azimuths[ring]);
      for (std::size_t i = 1; i < azimuths[ring].size(); ++i)
        ASSERT_NEAR(azimuths[ring][i] - azimuths[ring][i - 1], dense ? 0.1 : 0.2, 1e-3) << channel;
    }
  }
  int even = 0, odd = 0;
  for (const Channel& c : config.spinning->channels.table)
    if (c.column_step == 2) ++(c.first_column == 0 ? even : odd);
  EXPECT_EQ(even, 32);
  EXPECT_EQ(odd, 32);
}

TEST(scan_pattern, runs_on_from_frame_to_frame) {
  for (const auto& [name, pattern] : all_patterns()) {
    SCOPED_TRACE(name);
    const RayRange sixth = frame(pattern, 6), seventh = frame(pattern, 7);
    EXPECT_EQ(sixth.last, seventh.first);
    const Ray last = pattern.ray(sixth.last - pattern.group_size());
    const Ray next = pattern.ray(seventh.first);
    const bool even = name != "table in bursts";
    EXPECT_NEAR(next.time_s - last.time_s, even ? 1 / pattern.groups_per_s() : 0.0031, 1e-9);
    EXPECT_GE(next.time_s, 0.7 - 1e-9);
    EXPECT_LT(last.time_s, 0.7);
  }
}

TEST(scan_pattern, does_not_repeat_where_turns_and_frames_differ) {
  PatternConfig config = spinning(1, 0, 0, 0.2);
  config.spinning->rate_hz = 7;
  const ScanPattern pattern(config, 0, kLevel, 0);
  EXPECT_NEAR(deg(azimuth(rays_of(pattern, 1), 0)), -0.7 * 360 + 360, 0.21);
}

TEST(scan_pattern, batches_of_rays_are_the_rays_one_by_one) {
  for (const auto& [name, pattern] : all_patterns()) {
    SCOPED_TRACE(name);
    const bool turned = name != "vlp16" && name != "avia";
    const Mat3 pose = turned ? rotation(0.4, -0.2, 0.1) : kLevel;
    for (const int k : {0, 4999}) {
      const RayRange all = frame(pattern, k);
      const RayRange range{all.first, std::min(all.last, all.first + 50 * pattern.group_size())};
      RayBatch rays;
      pattern.generate(range, k * kUsualPeriod_s, rays);
      ASSERT_EQ(rays.size(), static_cast<std::size_t>(range.size()));
      for (std::size_t i = 0; i < rays.size(); ++i) {
        const Ray one = pattern.ray(range.first + static_cast<std::int64_t>(i));
        const Vec3 d = pose * one.direction;
        ASSERT_LT(norm(d - Vec3{rays.dx[i], rays.dy[i], rays.dz[i]}), 1e-6) << k << " " << i;
        ASSERT_NEAR(rays.time[i], one.time_s - k * kUsualPeriod_s, 1e-6);
        ASSERT_NEAR(norm(one.direction), 1, 1e-9);
      }
    }
  }
}

TEST(scan_pattern, slices_of_a_frame_have_every_ray_once) {
  for (const auto& [name, pattern] : all_patterns())
    for (const int k : {0, 7, 4999}) {
      SCOPED_TRACE(name + " frame " + std::to_string(k));
      const RayRange whole = frame(pattern, k);
      std::int64_t next = whole.first;
      for (int i = 0; i < 100; ++i) {
        const RayRange slice = pattern.fired_between((k + i / 100.0) * kUsualPeriod_s,
                                                     (k + (i + 1) / 100.0) * kUsualPeriod_s);
        EXPECT_EQ(slice.first, next);
        EXPECT_GE(slice.size(), 0);
        next = slice.last;
      }
      EXPECT_EQ(next, whole.last);
      EXPECT_EQ(whole.size() % pattern.group_size(), 0);
    }
}

TEST(scan_pattern, fires_within_its_frame) {
  for (const auto& [name, pattern] : all_patterns())
    for (const int k : {0, 4999}) {
      SCOPED_TRACE(name + " frame " + std::to_string(k));
      const RayBatch rays = rays_of(pattern, k);
      EXPECT_GE(*std::ranges::min_element(rays.time), -1e-6);
      // The channels of the last column may fire after the end of the frame.
      EXPECT_LT(*std::ranges::max_element(rays.time), 0.1 + 1 / pattern.groups_per_s());
    }
}

TEST(scan_pattern, tiles_hold_every_ray_once) {
  for (const int channels : {1, 3, 4, 5, 16})
    for (const int groups : {1, 4, 6, 9}) {
      const ScanPattern pattern(spinning(channels, -9, 9, 1), 0, kLevel, 0);
      auto order = pattern.tile_order(groups);
      std::ranges::sort(order);
      std::vector<std::uint32_t> wanted(static_cast<std::size_t>(channels) * groups);
      std::iota(wanted.begin(), wanted.end(), 0U);
      EXPECT_EQ(order, wanted);
    }
}

TEST(scan_pattern, a_tile_is_4_columns_of_4_neighbouring_rings) {
  const ScanPattern pattern(vlp16(), 0, kLevel, 0);
  const auto order = pattern.tile_order(8);
  const RayBatch rays = rays_of(pattern, 0);
  for (std::size_t first = 0; first < order.size(); first += 16) {
    std::vector<int> rings, columns;
    for (std::size_t i = first; i < first + 16; ++i) {
      rings.push_back(rays.ring[order[i]]);
      columns.push_back(static_cast<int>(order[i] / 16));
    }
    const auto span = [](const std::vector<int>& v) {
      return *std::ranges::max_element(v) - *std::ranges::min_element(v) + 1;
    };
    EXPECT_EQ(span(rings), 4);
    EXPECT_EQ(span(columns), 4);
  }
}

// --- table ------------------------------------------------------------------------------------

TEST(table_pattern, fires_at_the_times_of_its_rows_over_and_over) {
  const std::vector<double> times = five_directions_in_bursts().table->times_s;
  constexpr double kTable_s = 5 / 1003.0;
  // With the phase, the pattern is 12 rows ahead: two repetitions of the table and two rows.
  for (const double phase_s : {0.0, 0.0123}) {
    const ScanPattern pattern(five_directions_in_bursts(), phase_s, kLevel, 0);
    const std::int64_t ahead = phase_s > 0 ? 12 : 0;
    const double start_s = phase_s > 0 ? 2 * kTable_s + times[2] : 0;
    std::int64_t row = 0;
    for (int k = 0; k < 20; ++k) {
      ASSERT_EQ(frame(pattern, k).first, row);  // no row is skipped between frames
      const RayBatch rays = rays_of(pattern, k);
      for (std::size_t i = 0; i < rays.size(); ++i, ++row) {
        const std::int64_t repetition = (row + ahead) / 5, at = (row + ahead) % 5;
        const double time_s = static_cast<double>(repetition) * kTable_s + times[at] - start_s;
        EXPECT_NEAR(rays.time[i], time_s - k * kUsualPeriod_s, 1e-7);
      }
    }
    EXPECT_NEAR(static_cast<double>(row), 2 * 1003, 5);
  }
}

TEST(table_pattern, repeats_its_rows_while_time_goes_on) {
  const ScanPattern pattern(five_directions(), 0, kLevel, 0);
  for (int i = 0; i < 5; ++i) {
    const Ray first = pattern.ray(i), later = pattern.ray(i + 5 * 1000);
    EXPECT_EQ(norm(first.direction - later.direction), 0);
    EXPECT_NEAR(later.time_s - first.time_s, 5000.0 / 1003, 1e-9);
  }
  EXPECT_NEAR(pattern.ray(4).direction.z, std::sin(1), 1e-12);
  EXPECT_NEAR(pattern.ray(1).direction.y, std::cos(0.2) * std::sin(0.1), 1e-12);
}

TEST(pattern_table, has_the_elevation_of_a_ray_straight_up) {
  LidarConfig lidar;
  LidarUnit& unit = lidar.units.emplace_back();
  unit.pitch_deg = -8;
  unit.pattern = vlp16();
  unit.pattern.spinning->channels.table = {Channel{.elevation_deg = 82}};
  EXPECT_NEAR(pattern_table(lidar, 0, 1, 1, std::nullopt).at(1), kPi / 2, 1e-7);
}

// --- field of view ----------------------------------------------------------------------------

TEST(field_of_view, is_that_of_a_whole_cycle) {
  PatternConfig slow = five_directions();
  slow.table->rays_per_s = 0.5;  // a repetition takes 10 s
  const FieldOfView some = field_of_view(ScanPattern(five_directions(), 0, kLevel, 0));
  const FieldOfView all = field_of_view(ScanPattern(slow, 0, kLevel, 0));
  EXPECT_EQ(all.azimuth_max_deg, some.azimuth_max_deg);
  EXPECT_EQ(all.elevation_max_deg, some.elevation_max_deg);
}

TEST(field_of_view, of_a_spinning_unit_has_no_gap_between_columns) {
  PatternConfig coarse = vlp16();
  coarse.spinning->azimuth_step_deg = 2;
  const FieldOfView all = field_of_view(ScanPattern(coarse, 0, kLevel, 0));
  EXPECT_EQ(all.azimuth_min_deg, -180);
  EXPECT_EQ(all.azimuth_max_deg, 180);
  EXPECT_NEAR(all.elevation_max_deg, 15, 1e-9);
}

TEST(field_of_view, of_a_table_may_go_through_180_degrees) {
  const auto span_of = [](double first_deg, double last_deg, double step_deg) {
    PatternConfig pattern = five_directions();
    pattern.table->directions.clear();
    for (double azimuth_deg = first_deg; azimuth_deg <= last_deg + 1e-9; azimuth_deg += step_deg)
      pattern.table->directions.push_back({rad(azimuth_deg), -0.1});
    std::swap(pattern.table->directions.front(), pattern.table->directions.back());
    return field_of_view(ScanPattern(pattern, 0, kLevel, 0));
  };
  struct Case {
    double first_deg, last_deg, step_deg, least_deg, most_deg;
  };
  for (const auto& [first, last, step, least, most] : {Case{-30, 30, 0.2, -30, 30},
                                                       {150, 210, 0.2, 150, 210},
                                                       {-210, -150, 0.2, 150, 210},
                                                       {100, 170, 5, 100, 170},
                                                       {0, 270, 0.5, 0, 270},
                                                       {25, 25, 1, 25, 25},
                                                       {-179.9, 179.9, 0.1, -179.9, 179.9},
                                                       {-170, 180, 10, -170, 180},
                                                       {-170.5, 179.5, 10, -170.5, 179.5}}) {
    const FieldOfView view = span_of(first, last, step);
    EXPECT_NEAR(view.azimuth_min_deg, least, 1e-9) << first << " to " << last;
    EXPECT_NEAR(view.azimuth_max_deg, most, 1e-9) << first << " to " << last;
  }
}

// --- prisms -----------------------------------------------------------------------------------

/// The expected shares and the extent are those of the vendor's scan table: 4 s with 240,000 rays
/// per second.
TEST(avia_pattern, covers_the_vendors_field_of_view_as_densely) {
  const ScanPattern pattern(avia(), 0, kLevel, 0);
  RayBatch rays;
  double widest = 0, highest = 0;
  std::vector<double> within{0, 0, 0, 0};
  const std::vector<double> limits{2.5, 5, 10, 15};
  double total = 0;
  for (int k = 0; k < 40; ++k) {
    pattern.generate(frame(pattern, k), k * kUsualPeriod_s, rays);
    total += static_cast<double>(rays.size());
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const double e = std::abs(deg(elevation(rays, i)));
      widest = std::max(widest, std::abs(deg(azimuth(rays, i))));
      highest = std::max(highest, e);
      for (std::size_t j = 0; j < limits.size(); ++j) within[j] += e < limits[j];
    }
  }
  EXPECT_EQ(total, 960000);
  EXPECT_NEAR(widest, 35.31, 0.02);
  EXPECT_NEAR(highest, 38.59, 0.02);
  EXPECT_NEAR(100 * within[0] / total, 15.5, 0.3);
  EXPECT_NEAR(100 * within[1] / total, 27.5, 0.3);
  EXPECT_NEAR(100 * within[2] / total, 45.9, 0.3);
  EXPECT_NEAR(100 * within[3] / total, 60.6, 0.3);
}

TEST(avia_pattern, does_not_repeat_within_its_first_second) {
  const ScanPattern pattern(avia(), 0, kLevel, 0);
  const Vec3 start = pattern.ray(0).direction;
  for (int k = 1; k < 10; ++k)
    EXPECT_GT(norm(pattern.ray(frame(pattern, k).first).direction - start), 1e-3) << k;
}

TEST(avia_pattern, its_top_laser_has_the_highest_ring) {
  const RayBatch rays = rays_of(ScanPattern(avia(), 0, kLevel, 0), 0);
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(rays.ring[i], 5 - i);
}

TEST(prism_pattern, without_tilt_leaves_the_light_as_it_is) {
  PatternConfig config = avia();
  for (PrismConfig& prism : config.prisms->prisms) prism.angle_deg = 0;
  const ScanPattern pattern(config, 0, kLevel, 0);
  EXPECT_NEAR(std::asin(pattern.ray(6000).direction.z), std::atan(1.175 / 30), 1e-12);
}

// --- start phase ------------------------------------------------------------------------------

TEST(start_phase, of_a_free_motor_is_drawn_from_seed_mount_and_unit_and_the_same_for_all_lidars) {
  LidarConfig lidar = testing::plain_lidar("a", vlp16());
  lidar.units.front().pattern.spinning->phase = MotorPhase::kFree;
  lidar.units.push_back(lidar.units.front());
  const double phase = start_phase_s(1, "pole", lidar, 0);
  EXPECT_GT(phase, 0);
  EXPECT_EQ(start_phase_s(1, "pole", lidar, 0), phase);
  EXPECT_NE(start_phase_s(2, "pole", lidar, 0), phase);
  EXPECT_NE(start_phase_s(1, "bridge", lidar, 0), phase);
  EXPECT_NE(start_phase_s(1, "pole", lidar, 1), phase);
  lidar.name = "b";
  EXPECT_EQ(start_phase_s(1, "pole", lidar, 0), phase);
}

TEST(start_phase, of_a_locked_motor_is_0_whatever_the_seed) {
  const LidarConfig spinning_lidar = testing::plain_lidar("a", vlp16());
  for (const std::uint64_t seed : {1, 2, 3})
    EXPECT_EQ(start_phase_s(seed, "pole", spinning_lidar, 0), 0);
}

TEST(start_phase, is_locked_of_spinning_units_and_free_of_all_others_unless_said_otherwise) {
  EXPECT_EQ(SpinningConfig{}.phase, MotorPhase::kLocked);
  LidarConfig lidar = testing::plain_lidar("a", avia());
  EXPECT_GT(start_phase_s(1, "pole", lidar, 0), 0);
  lidar.units.front().pattern.prisms->phase = MotorPhase::kLocked;
  EXPECT_EQ(start_phase_s(1, "pole", lidar, 0), 0);
  lidar = testing::plain_lidar("a", five_directions());
  EXPECT_GT(start_phase_s(1, "pole", lidar, 0), 0);
}

/// Returns the azimuth of the first ray of a frame, in degrees.
double first_azimuth(const PatternConfig& config, int k, const Mat3& pose = kLevel) {
  return deg(azimuth(rays_of(ScanPattern(config, 0, pose, 0), k), 0));
}

TEST(locked_motor, begins_behind_the_view_unless_said_otherwise) {
  PatternConfig config = in_columns({1800, 1});
  config.spinning->cut_angle_deg = SpinningConfig{}.cut_angle_deg;
  EXPECT_NEAR(std::abs(first_azimuth(config, 0)), 180, 1e-4);
  for (const double cut_angle : {-135, 0, 35, 90}) {
    config.spinning->cut_angle_deg = cut_angle;
    for (const int k : {0, 1, 4999}) EXPECT_NEAR(first_azimuth(config, k), cut_angle, 1e-4) << k;
  }
}

TEST(locked_motor, is_turned_along_with_its_unit_and_its_mount) {
  PatternConfig config = in_columns({1800, 1});
  config.spinning->cut_angle_deg = 35;
  EXPECT_NEAR(first_azimuth(config, 3, rotation(rad(-90), 0, 0)), -55, 1e-4);
}

TEST(locked_motor, is_at_its_cut_angle_at_the_begin_of_every_frame_of_one_turn) {
  PatternConfig config = in_columns({1800, 1});
  for (const double rate_hz : {5.0, 10.0, 20.0}) {
    config.spinning->rate_hz = rate_hz;
    const ScanPattern pattern(config, 0, kLevel, 0);
    for (const int k : {0, 1, 7, 4999}) {
      const RayRange turn = pattern.fired_between(k / rate_hz, (k + 1) / rate_hz);
      EXPECT_EQ(turn.size(), 1800 * 16);
      EXPECT_NEAR(pattern.ray(turn.first).direction.x, pattern.ray(0).direction.x, 1e-9) << k;
    }
  }
}

TEST(locked_motor, of_a_fraction_of_columns_moves_by_fractions_of_a_column) {
  PatternConfig config = in_columns({8125, 4});
  std::vector<double> off;
  for (int k = 0; k < 5; ++k) off.push_back(-first_azimuth(config, k) / (360 * 4 / 8125.0));
  EXPECT_NEAR(off[0], 0, 1e-3);
  EXPECT_NEAR(off[1], 0.75, 1e-3);  // the first column of the second turn is column 2032
  EXPECT_NEAR(off[2], 0.5, 1e-3);
  EXPECT_NEAR(off[3], 0.25, 1e-3);
  EXPECT_NEAR(off[4], 0, 1e-3);
}

}  // namespace
}  // namespace infrasim
