#include "infrasim/config/lidar_keys.h"

#include <cmath>
#include <numeric>

namespace infrasim {

using config::at_least_one;
using config::between;
using config::positive;
using config::required;

namespace {

// Maximum number of passages of rays through prisms per second. A passage takes about 0.1 us of
// computing time. A Livox Horizon has 720,000 passages per second.
constexpr double kMostPassagesPerSecond = 1e7;

}  // namespace

std::span<const char* const> enum_names(Faces) {
  static constexpr std::array kNames{"tilted_first", "flat_first"};
  return kNames;
}

std::span<const char* const> enum_names(MotorPhase) {
  static constexpr std::array kNames{"locked", "free"};
  return kNames;
}

template <class Fields>
void visit(Fields& f, Channel& c) {
  f.field("elevation_deg", c.elevation_deg, "elevation above the horizon",
          required(between(-90, 90)));
  f.field("azimuth_offset_deg", c.azimuth_offset_deg, "azimuth offset in the direction of rotation",
          between(-180, 180));
  f.field("fire_time_us", c.fire_time_us, "firing time after the start of the column",
          between(0, 1e6));
  f.field("column_step", c.column_step,
          "the channel fires in every column_step-th column; 1: in all columns",
          between(1, kMostColumnStep));
  f.field("first_column", c.first_column, "first column in which the channel fires, from 0",
          between(0, kMostColumnStep - 1));
  f.field("range_at_10_percent_m", c.range_at_10_percent_m,
          "range of this channel on a 10 % target in full sun; default: that of returns.detection, "
          "without which the key has no effect",
          positive(kLongestPublishedRange_m));
  f.field(
      "min_range_m", c.min_range_m,
      "shortest range of a return of this channel, for presets with returns.detection; default: "
      "that of returns",
      between(0, kLongestMinRange_m));
  f.check(c.first_column < c.column_step, "first_column",
          "expected below column_step, got " + std::to_string(c.first_column));
}

template <class Fields>
void visit(Fields& f, ChannelsConfig& c) {
  f.field("count", c.count, "number of evenly spaced channels", between(0, 65535));
  f.field("upper_deg", c.upper_deg, "elevation of the first channel; default: 0", between(-90, 90));
  f.field("lower_deg", c.lower_deg,
          "elevation of the last channel; default: 0, or upper_deg for one channel",
          between(-90, 90));
  f.field("file", c.file, "table of channels, relative to this file");
  f.here(c.file_key, "file");
  f.field("table", c.table, "channels, in the order of their points in a column");
  const int ways = (c.count > 0) + !c.file.empty() + !c.table.empty();
  f.check(ways == 1, "count", "expected one of count, file, table, got none or several");
  const double upper = c.upper_deg.value_or(0), lower = c.lower_deg.value_or(0);
  f.check(c.count <= 1 || upper > lower, "upper_deg",
          "expected above lower_deg, got lower_deg or less");
  f.check(c.count != 1 || !c.upper_deg || !c.lower_deg || upper == lower, "upper_deg",
          "expected lower_deg, as one channel has one elevation, got another angle");
}

namespace {

constexpr std::int64_t kLargest = 1'000'000'000;

/// Returns the value of a number's shortest decimal text as an exact fraction; no value if the
/// numerator or the denominator is above kLargest.
std::optional<Fraction> decimal_fraction(double value) {
  for (std::int64_t power = 1; power <= kLargest; power *= 10) {
    const double scaled = value * static_cast<double>(power);
    if (scaled > static_cast<double>(kLargest)) break;
    const std::int64_t whole = std::llround(scaled);
    if (whole == 0 || static_cast<double>(whole) / static_cast<double>(power) != value) continue;
    const std::int64_t divisor = std::gcd(whole, power);
    return Fraction{whole / divisor, power / divisor};
  }
  return std::nullopt;
}

/// Returns a / b; no value if the numerator or the denominator of the result is above kLargest.
std::optional<Fraction> ratio(const Fraction& a, const Fraction& b) {
  const std::int64_t x = std::gcd(a.numerator, b.numerator);
  const std::int64_t y = std::gcd(a.denominator, b.denominator);
  const std::int64_t numerator = a.numerator / x * (b.denominator / y);
  const std::int64_t denominator = a.denominator / y * (b.numerator / x);
  if (numerator > kLargest || denominator > kLargest) return std::nullopt;
  return Fraction{numerator, denominator};
}

}  // namespace

int columns_per_group(const SpinningConfig& spinning) {
  int columns = 1;
  for (const Channel& c : spinning.channels.table) columns = std::lcm(columns, c.column_step);
  return columns;
}

double columns_per_s(const SpinningConfig& spinning) {
  if (spinning.cycle_us) return 1e6 / *spinning.cycle_us;
  const auto& step_deg = spinning.azimuth_step_deg;
  return step_deg ? spinning.rate_hz * 360 / *step_deg
                  : spinning.rate_hz * spinning.columns_per_turn->value();
}

std::optional<Fraction> columns_per_turn(const SpinningConfig& spinning) {
  if (spinning.cycle_us) {
    const auto cycle = decimal_fraction(*spinning.cycle_us);
    const auto rate = decimal_fraction(spinning.rate_hz);
    const auto cycles_per_s = cycle ? ratio({1'000'000, 1}, *cycle) : std::nullopt;
    return cycles_per_s && rate ? ratio(*cycles_per_s, *rate) : std::nullopt;
  }
  if (!spinning.azimuth_step_deg) return spinning.columns_per_turn;
  constexpr std::int64_t kMostTurns = 16;
  for (std::int64_t turns = 1; turns <= kMostTurns; ++turns) {
    const double degrees = 360.0 * static_cast<double>(turns);
    const std::int64_t columns = std::llround(degrees / *spinning.azimuth_step_deg);
    if (degrees / static_cast<double>(columns) == *spinning.azimuth_step_deg)
      return Fraction{columns, turns};
  }
  return std::nullopt;
}

template <class Fields>
void visit(Fields& f, SpinningConfig& c) {
  f.field("rate_hz", c.rate_hz, "turns per second; a frame is one turn",
          required(between(1 / kLongestPeriod_s, 1 / kShortestPeriod_s)));
  f.field("phase", c.phase,
          "locked: the motor is at cut_angle_deg at time 0; free: the motor starts at a random "
          "angle, which depends on the seed");
  f.field("cut_angle_deg", c.cut_angle_deg,
          "azimuth at which a frame begins and ends, in the frame of the unit", between(-360, 360));
  f.field("azimuth_step_deg", c.azimuth_step_deg,
          "angle between two columns; replaces columns_per_turn and cycle_us", positive(90));
  f.field("columns_per_turn", c.columns_per_turn,
          "number of columns per turn, such as 1800 or 8125/4; replaces azimuth_step_deg and "
          "cycle_us",
          between(4, 1e9));
  f.field("cycle_us", c.cycle_us,
          "time between two columns, such as 55.296, at any rate_hz; replaces azimuth_step_deg and "
          "columns_per_turn",
          positive(1e6));
  f.field("channels", c.channels, "channels of the LiDAR", required());
  const char* step = c.cycle_us           ? "cycle_us"
                     : c.columns_per_turn ? "columns_per_turn"
                                          : "azimuth_step_deg";
  const int ways =
      c.azimuth_step_deg.has_value() + c.columns_per_turn.has_value() + c.cycle_us.has_value();
  const bool one = ways == 1;
  f.check(one, step,
          "expected one of azimuth_step_deg, columns_per_turn, cycle_us, got none or several");
  const double columns = one ? columns_per_s(c) : kFewestPerSecond;
  f.check(columns >= kFewestPerSecond && columns <= kMostRaysPerSecond,
          columns < kFewestPerSecond ? "rate_hz" : step,
          "expected " + config::number_text(kFewestPerSecond) + " to " +
              config::number_text(kMostRaysPerSecond) + " columns a second, got " +
              config::number_text(columns));
  f.check(!one || columns >= 4 * c.rate_hz, step,
          "expected 4 or more columns per turn, got " + config::number_text(columns / c.rate_hz));
}

template <class Fields>
void visit(Fields& f, PrismConfig& c) {
  f.field("rpm", c.rpm, "turns per minute, signed", required(between(-1e6, 1e6)));
  f.field("angle_deg", c.angle_deg, "wedge angle between the faces, signed",
          required(between(-45, 45)));
  f.field("refractive_index", c.refractive_index, "refractive index of the glass",
          required(between(1, 4)));
  f.field("faces", c.faces, "which face the light passes first", required());
  f.field("phase_deg", c.phase_deg, "angle at time 0", between(-360, 360));
}

template <class Fields>
void visit(Fields& f, PrismsConfig& c) {
  f.field("steps_per_s", c.steps_per_s, "firings per second",
          required(between(kFewestPerSecond, 1e7)));
  f.field("period_s", c.period_s, "frame period", between(kShortestPeriod_s, kLongestPeriod_s));
  f.field("phase", c.phase,
          "locked: the firing first_step is at time 0; free: the pattern starts at a random "
          "firing, which depends on the seed");
  f.field("first_step", c.first_step, "index of the firing at time 0", between(0, 1e6));
  f.field("focal_length", c.focal_length, "focal length, in the unit of laser_offsets", positive());
  f.field("laser_offsets", c.laser_offsets,
          "offsets of the lasers that fire at the same time, from the top", at_least_one());
  f.field("prisms", c.prisms, "prisms in the order in which the light passes them", at_least_one());
  const double passages = c.steps_per_s * static_cast<double>(c.laser_offsets.size()) *
                          static_cast<double>(c.prisms.size());
  f.check(passages <= kMostPassagesPerSecond, "steps_per_s",
          "expected up to " + config::number_text(kMostPassagesPerSecond) + ", got " +
              config::number_text(passages) +
              " passages of light through prisms per second (steps_per_s x lasers x prisms)");
}

template <class Fields>
void visit(Fields& f, TableConfig& c) {
  f.field("file", c.file, ".npy or .csv file with columns azimuth, elevation and optionally time",
          required());
  f.here(c.file_key, "file");
  f.field("rays_per_s", c.rays_per_s, "rays per second; needed for a table without times",
          between(kFewestPerSecond, kMostRaysPerSecond));
  f.field("period_s", c.period_s, "frame period", between(kShortestPeriod_s, kLongestPeriod_s));
  f.field("phase", c.phase,
          "locked: the first row is at time 0; free: the pattern starts at a random row, which "
          "depends on the seed");
  f.field("digest", c.digest, "digest of the rows; a run writes it, and a given digest is checked");
}

template <class Fields>
void visit(Fields& f, PatternConfig& c) {
  f.field("spinning", c.spinning, "rotating LiDAR, which fires columns of channels");
  f.field("prisms", c.prisms, "rotating Risley prisms (Livox)");
  f.field("table", c.table, "ray directions from a file");
  f.check(c.spinning.has_value() + c.prisms.has_value() + c.table.has_value() == 1, "spinning",
          "expected one of spinning, prisms, table, got none or several");
}

template void visit(config::FieldReader&, PatternConfig&);
template void visit(config::FieldWriter&, PatternConfig&);
template void visit(config::FieldLister&, PatternConfig&);

}  // namespace infrasim
