#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <random>
#include <string>
#include <vector>

#include "infrasim/core/errors.h"
#include "infrasim/core/geometry.h"
#include "infrasim/core/numbers.h"
#include "infrasim/core/rng.h"

namespace infrasim {
namespace {

bool overlap(const Box3d& a, const Box3d& b) {
  return footprints_overlap(footprint(a), footprint(b));
}

Box3d car(double x, double y, double heading_deg) {
  return {.x = x, .y = y, .dx = 4, .dy = 2, .dz = 1.5, .heading = rad(heading_deg)};
}

TEST(error, escapes_what_a_terminal_would_obey_and_what_is_no_utf_8) {
  EXPECT_STREQ(ConfigError("a\x1b[31m\x7f").what(), "a\\x1b[31m\\x7f");
  EXPECT_STREQ(IoError("Straße 5 € 🚗").what(), "Straße 5 € 🚗");
  EXPECT_EQ(printable(std::string("\0\n", 2)), "\\x00\\x0a");
  EXPECT_EQ(printable("\xc2\x9b"), "\\xc2\\x9b");           // a control character of Latin-1
  EXPECT_EQ(printable("\xe0\x80\x80"), "\\xe0\\x80\\x80");  // longer than necessary
  EXPECT_EQ(printable("\xed\xa0\x80"), "\\xed\\xa0\\x80");  // half of a UTF-16 surrogate pair
  EXPECT_EQ(printable("\xf4\x90\x80\x80"), "\\xf4\\x90\\x80\\x80");
  EXPECT_EQ(printable("ab\xc3"), "ab\\xc3");
  EXPECT_EQ(printable(""), "");
}

TEST(fixed_text, is_what_printf_gives_in_the_c_locale) {
  std::mt19937_64 random(3);
  std::vector<double> values{0,       -0.0, 0.5, -0.00004, 0.00005, 1e15, -1.7976931348623157e308,
                             2.5e-320};
  for (int i = 0; i < 2000; ++i) {
    values.push_back(std::uniform_real_distribution<double>(-500, 500)(random));
    values.push_back(static_cast<float>(values.back()));
    // a value half way between two numbers with four decimals
    values.push_back(std::round(values.back() * 1e4) / 1e4 + 5e-5);
  }
  for (const double value : values)
    for (const int digits : {0, 4, 6}) {
      std::array<char, 400> wanted{};
      std::snprintf(wanted.data(), wanted.size(), "%.*f", digits, value);
      EXPECT_EQ(fixed_text(value, digits), wanted.data());
    }
}

TEST(angle, wraps_into_minus_pi_to_pi) {
  for (double angle = -20; angle < 20; angle += 0.37) {
    const double wrapped = wrap_angle(angle);
    EXPECT_GE(wrapped, -kPi);
    EXPECT_LT(wrapped, kPi);
    EXPECT_NEAR(std::cos(wrapped), std::cos(angle), 1e-12);
    EXPECT_NEAR(std::sin(wrapped), std::sin(angle), 1e-12);
  }
  EXPECT_EQ(wrap_angle(kPi), -kPi);
}

TEST(rotation, positive_yaw_turns_left_and_positive_pitch_looks_down) {
  const Vec3 forward{1, 0, 0};
  EXPECT_NEAR((rotation(rad(90), 0, 0) * forward).y, 1, 1e-12);
  EXPECT_NEAR((rotation(0, rad(30), 0) * forward).z, -0.5, 1e-12);
}

TEST(rotation, keeps_lengths) {
  const Vec3 v{1, -2, 3};
  EXPECT_NEAR(norm(rotation(0.3, -0.7, 2.1) * v), norm(v), 1e-12);
}

TEST(footprint, has_the_area_of_the_box_and_goes_counter_clockwise) {
  const auto corners = footprint(car(3, -1, 25));
  double twice_area = 0;
  for (std::size_t i = 0; i < 4; ++i) twice_area += cross(corners[i], corners[(i + 1) % 4]);
  EXPECT_NEAR(twice_area, 2 * 4 * 2, 1e-12);
}

TEST(footprint, starts_at_the_front_right) {
  const Vec2 corner = footprint(car(10, 5, 0)).front();
  EXPECT_NEAR(corner.x, 12, 1e-12);
  EXPECT_NEAR(corner.y, 4, 1e-12);
}

TEST(footprints, overlap_themselves) { EXPECT_TRUE(overlap(car(0, 0, 30), car(0, 0, 30))); }

TEST(footprints, that_touch_do_not_overlap) {
  EXPECT_FALSE(overlap(car(0, 0, 0), car(0, 2, 0)));
  EXPECT_TRUE(overlap(car(0, 0, 0), car(0, 1.999, 0)));
}

TEST(footprints, that_cross_overlap_though_no_corner_lies_in_the_other) {
  EXPECT_TRUE(overlap(car(0, 0, 0), car(0, 0, 90)));
}

TEST(footprints, of_parked_cars_at_an_angle_do_not_overlap_though_their_extents_do) {
  EXPECT_FALSE(overlap(car(0, 0, 45), car(2, -2, 45)));
}

TEST(footprints, overlap_does_not_depend_on_where_one_stands_or_looks) {
  const unsigned seed = 7;
  SCOPED_TRACE(seed);
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> offset(-5, 5);
  std::uniform_real_distribution<double> turn(-kPi, kPi);
  int overlaps = 0;
  for (int i = 0; i < 1000; ++i) {
    Box3d a = car(0, 0, deg(turn(random)));
    Box3d b = car(offset(random), offset(random), deg(turn(random)));
    const bool before = overlap(a, b);
    overlaps += before;
    EXPECT_EQ(overlap(b, a), before);
    const double yaw = turn(random);
    const Vec2 shift{offset(random), offset(random)};
    for (Box3d* box : {&a, &b}) {
      const Vec2 moved =
          shift + box->x * heading_vector(yaw) + box->y * heading_vector(yaw + kPi / 2);
      box->x = moved.x;
      box->y = moved.y;
      box->heading += yaw;
    }
    EXPECT_EQ(overlap(a, b), before);
  }
  EXPECT_GT(overlaps, 100);
  EXPECT_LT(overlaps, 900);
}

// Returns the chi-squared statistic of uniform samples in 100 bins. The 99.99 % quantile of its
// distribution, which has 99 degrees of freedom, is 161.
double chi_squared(const std::vector<double>& draws) {
  std::array<int, 100> bins{};
  for (const double u : draws) ++bins.at(static_cast<std::size_t>(100 * u));
  const double expected = static_cast<double>(draws.size()) / 100;
  return std::accumulate(bins.begin(), bins.end(), 0.0, [&](double sum, int n) {
    return sum + (n - expected) * (n - expected) / expected;
  });
}

TEST(rng, is_uniform_over_rays_over_draws_and_over_frames) {
  const Rng frame = Rng::of(1, "avia").at(1);
  std::vector<double> rays;
  std::vector<double> draws;
  std::vector<double> frames;
  for (unsigned i = 0; i < 100000; ++i) {
    rays.push_back(frame.at(i).uniform(0));
    draws.push_back(frame.uniform(i));
    frames.push_back(Rng::of(1, "avia").at(i).uniform(0));
  }
  EXPECT_LT(chi_squared(rays), 161);
  EXPECT_LT(chi_squared(draws), 161);
  EXPECT_LT(chi_squared(frames), 161);
}

TEST(rng, neighbouring_rays_and_draws_are_not_correlated) {
  const Rng frame = Rng::of(1, "avia").at(1);
  const int n = 100000;
  double rays = 0;
  double draws = 0;
  for (unsigned i = 0; i < n; ++i) {
    const double u = frame.at(i).uniform(0) - 0.5;
    rays += u * (frame.at(i + 1).uniform(0) - 0.5);
    draws += u * (frame.at(i).uniform(1) - 0.5);
  }
  const double five_sigma = 5 * std::sqrt(n) / 12;
  EXPECT_LT(std::abs(rays), five_sigma);
  EXPECT_LT(std::abs(draws), five_sigma);
}

TEST(rng, frames_are_not_shifted_copies_of_each_other) {
  const Rng lidar = Rng::of(1, "avia");
  const int n = 100000;
  for (const int shift : {-2, -1, 0, 1, 2}) {
    double sum = 0;
    for (std::int64_t i = 2; i < n + 2; ++i) {
      const auto ray = static_cast<std::uint64_t>(i);
      const auto other = static_cast<std::uint64_t>(i + shift);
      sum += (lidar.at(1).at(other).uniform(0) - 0.5) * (lidar.at(2).at(ray).uniform(0) - 0.5);
    }
    EXPECT_LT(std::abs(sum), 5 * std::sqrt(n) / 12) << shift;
  }
}

TEST(rng, a_draw_does_not_depend_on_the_order_of_the_draws) {
  const Rng frame = Rng::of(3, "vlp16").at(12);
  std::vector<unsigned> order(1000);
  std::iota(order.begin(), order.end(), 0U);
  std::vector<double> forward;
  for (const unsigned i : order) forward.push_back(frame.at(i).uniform(2));
  std::ranges::reverse(order);
  for (const unsigned i : order) EXPECT_EQ(frame.at(i).uniform(2), forward[i]);
}

TEST(rng, seed_name_and_frame_each_change_the_draws) {
  const double draw = Rng::of(1, "avia").at(0).uniform(0);
  EXPECT_EQ(Rng::of(1, "avia").at(0).uniform(0), draw);
  EXPECT_NE(Rng::of(2, "avia").at(0).uniform(0), draw);
  EXPECT_NE(Rng::of(1, "vlp16").at(0).uniform(0), draw);
  EXPECT_NE(Rng::of(1, "avia").at(1).uniform(0), draw);
}

TEST(rng, normal_draws_have_mean_0_and_deviation_1) {
  const Rng frame = Rng::of(1, "avia").at(1);
  const int n = 100000;
  double sum = 0;
  double squares = 0;
  for (unsigned i = 0; i < n; ++i) {
    const double x = frame.at(i).normal(0);
    sum += x;
    squares += x * x;
  }
  EXPECT_NEAR(sum / n, 0, 5 / std::sqrt(n));
  EXPECT_NEAR(squares / n, 1, 5 * std::sqrt(2.0 / n));
}

}  // namespace
}  // namespace infrasim
