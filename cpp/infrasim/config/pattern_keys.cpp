#include "infrasim/config/pattern_keys.h"

#include "infrasim/config/fields.h"
#include "infrasim/config/key_list.h"

namespace infrasim {

using config::at_least_one;
using config::between;
using config::positive;
using config::required;

namespace {

// Tracing a ray through a prism takes about 0.1 us. The rays of a Livox Horizon pass through
// 720,000 prisms per second.
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
}

template <class Fields>
void visit(Fields& f, ChannelsConfig& c) {
  f.field("count", c.count, "number of evenly spaced channels", between(0, 65535));
  f.field("upper_deg", c.upper_deg, "elevation of the first channel; default: 0", between(-90, 90));
  f.field("lower_deg", c.lower_deg,
          "elevation of the last channel; default: 0, or upper_deg for one channel",
          between(-90, 90));
  f.field("file", c.file, "table of channels, relative to this file");
  f.field("table", c.table, "channels, in the order of their points in a column");
  const int ways = (c.count > 0) + !c.file.empty() + !c.table.empty();
  f.check(ways == 1, "count", "expected one of count, file, table, got none or several");
  const double upper = c.upper_deg.value_or(0), lower = c.lower_deg.value_or(0);
  f.check(c.count <= 1 || upper > lower, "upper_deg", "expected above lower_deg, got at most that");
  f.check(c.count != 1 || !c.upper_deg || !c.lower_deg || upper == lower, "upper_deg",
          "expected lower_deg, as one channel has one elevation, got another angle");
}

double columns_per_s(const SpinningConfig& spinning) {
  const auto& step_deg = spinning.azimuth_step_deg;
  return step_deg ? spinning.rate_hz * 360 / *step_deg
                  : spinning.rate_hz * spinning.columns_per_turn->value();
}

std::optional<Fraction> columns_per_turn(const SpinningConfig& spinning) {
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
  f.field("rate_hz", c.rate_hz, "turns per second", required(positive(1000)));
  f.field("phase", c.phase,
          "locked: the motor is at cut_angle_deg at time 0; free: the motor starts at a random "
          "angle, which depends on the seed");
  f.field("cut_angle_deg", c.cut_angle_deg,
          "azimuth at which a frame begins and ends, in the frame of the unit", between(-360, 360));
  f.field("azimuth_step_deg", c.azimuth_step_deg,
          "angle between two columns; replaces columns_per_turn", positive(90));
  f.field("columns_per_turn", c.columns_per_turn,
          "number of columns per turn, such as 1800 or 8125/4; replaces azimuth_step_deg",
          between(4, 1e9));
  f.field("channels", c.channels, "channels of the LiDAR", required());
  const char* step = c.columns_per_turn ? "columns_per_turn" : "azimuth_step_deg";
  const bool one = c.azimuth_step_deg.has_value() != c.columns_per_turn.has_value();
  f.check(one, step, "expected azimuth_step_deg or columns_per_turn, got both or neither");
  const double columns = one ? columns_per_s(c) : kFewestPerSecond;
  f.check(columns >= kFewestPerSecond && columns <= kMostRaysPerSecond,
          columns < kFewestPerSecond ? "rate_hz" : step,
          "expected " + config::number_text(kFewestPerSecond) + " to " +
              config::number_text(kMostRaysPerSecond) + " columns a second, got " +
              config::number_text(columns));
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
              " passages of light through prisms a second (steps, lasers and prisms)");
}

template <class Fields>
void visit(Fields& f, TableConfig& c) {
  f.field("file", c.file, ".npy or .csv file with columns azimuth, elevation and optionally time",
          required());
  f.field("rays_per_s", c.rays_per_s, "rays per second; needed for a table without times",
          between(kFewestPerSecond, kMostRaysPerSecond));
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
