#include "infrasim/config/lidar_keys.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <ranges>

#include "infrasim/core/math.h"

namespace infrasim {

using config::between;
using config::positive;
using config::required;

template <class Fields>
void visit(Fields& f, DropOffConfig& c) {
  f.field("general_rate", c.general_rate, "share of the points that is lost at random",
          required(between(0, 1)));
  f.field("intensity_limit", c.intensity_limit, "points with a higher intensity are kept",
          required(positive(1)));
  f.field("zero_intensity_rate", c.zero_intensity_rate,
          "share of the points with intensity 0 that is lost", required(between(0, 1)));
}

// minimum reflectance of a target; data sheets have 5 % and more
constexpr double kLeastReflectance = 0.001;

template <class Fields>
void visit(Fields& f, PublishedRange& c) {
  f.field("range_m", c.range_m, "range from the data sheet",
          required(positive(kLongestPublishedRange_m)));
  f.field("reflectance", c.reflectance, "reflectance of the target",
          required(between(kLeastReflectance, 1)));
  f.field("sunlight_klux", c.sunlight_klux, "illuminance of the target; 0: night", between(0, 200));
}

std::vector<PublishedRange> published_ranges(const DetectionConfig& detection) {
  std::vector<PublishedRange> ranges{{.range_m = detection.range_at_10_percent_m}};
  ranges.insert(ranges.end(), detection.further_ranges.begin(), detection.further_ranges.end());
  return ranges;
}

std::string range_text(const PublishedRange& r) {
  return config::number_text(r.range_m) + " m at " + config::number_text(100 * r.reflectance) +
         " % in " + config::number_text(r.sunlight_klux) + " klx";
}

namespace {

/// Maximum probability that a target without a signal is detected. With this value, a car that 100
/// rays hit beyond the LiDAR's range has a point in one of 100 frames.
constexpr double kMostFalseAlarms = 1e-4;

/// Returns a text with two published ranges that contradict each other; empty if there are none.
/// Two ranges contradict each other if the target of the shorter one has the same or a higher
/// reflectance and the same or less sunlight.
std::string contradiction(const DetectionConfig& detection) {
  const std::vector<PublishedRange> ranges = published_ranges(detection);
  for (const PublishedRange& a : ranges)
    for (const PublishedRange& b : ranges)
      if (a.reflectance >= b.reflectance && a.sunlight_klux <= b.sunlight_klux &&
          a.range_m < b.range_m)
        return range_text(a) + " beside " + range_text(b);
  return {};
}

}  // namespace

template <class Fields>
void visit(Fields& f, DetectionConfig& c) {
  f.field("range_at_10_percent_m", c.range_at_10_percent_m,
          "range on a target with a reflectance of 10 % in full sun (100 klx)",
          required(positive(kLongestPublishedRange_m)));
  f.field("further_ranges", c.further_ranges,
          "ranges on other targets or in other light, which determine how range depends on "
          "reflectance");
  f.field("law_exponent", c.law_exponent,
          "power of the reflectance with which the range grows in full sun, for a LiDAR without "
          "further_ranges; default: 0.25",
          between(kLeastExponent, kMostExponent));
  f.field("steepness", c.steepness,
          "steepness of the detection probability over the signal-to-noise ratio; below 3.72 is "
          "refused, because rays would return without a signal",
          positive(1000));
  const double false_alarms = math::erfc(c.steepness / std::numbers::sqrt2) / 2;
  f.check(false_alarms <= kMostFalseAlarms, "steepness",
          "expected a steepness at which at most 1 of " +
              config::number_text(std::round(1 / kMostFalseAlarms)) +
              " rays returns without a signal, such as 4, got " + config::number_text(c.steepness) +
              ", at which " + config::number_text(std::round(1e6 * false_alarms) / 1e4) +
              " % of them return");
  f.check(!c.law_exponent || c.further_ranges.empty(), "law_exponent",
          "expected law_exponent or further_ranges, which determine the exponent, got both");
  const std::string both = contradiction(c);
  f.check(both.empty(), "further_ranges",
          "expected ranges that grow with reflectance and shrink with sunlight, got " + both);
}

std::span<const char* const> enum_names(BeamWhere) {
  static constexpr std::array<const char*, 2> kNames{"moving", "everywhere"};
  return kNames;
}

std::span<const char* const> enum_names(EchoMode) {
  static constexpr std::array<const char*, 4> kNames{"strongest", "first", "last", "dual"};
  return kNames;
}

std::string unoffered_mode(const EchoesConfig& c) {
  if (c.offered.empty() || std::ranges::find(c.offered, c.mode) != c.offered.end()) return {};
  const auto name = [](EchoMode mode) {
    return std::string(enum_names(mode)[static_cast<std::size_t>(mode)]);
  };
  return "expected a mode that the sensor offers (" +
         listed(c.offered | std::views::transform(name)) + "), got " + name(c.mode);
}

template <class Fields>
void visit(Fields& f, EchoesConfig& c) {
  f.field(
      "mode", c.mode,
      "echoes of a ray that become points: the strongest, the first, the last, or two, the "
      "strongest and the last (dual; if the last is the strongest, it and the second strongest)");
  f.field("separation_m", c.separation_m,
          "minimum distance between two echoes of a ray; nearer ones merge", between(0, 10));
  f.field("offered", c.offered, "modes that the sensor offers; if empty, all");
  const std::string unoffered = unoffered_mode(c);
  f.check(unoffered.empty(), "mode", unoffered);
}

template <class Fields>
void visit(Fields& f, BeamConfig& c) {
  f.field("vertical_deg", c.vertical_deg, "full vertical divergence", required(between(0, 10)));
  f.field("horizontal_deg", c.horizontal_deg, "full horizontal divergence",
          required(between(0, 10)));
  f.field("sub_rays", c.sub_rays,
          "number of sub-rays across the beam, odd; 3 are 7 in total, 5 are 19, 7 are 37",
          between(3, 31));
  f.field("where", c.where,
          "where a beam has sub-rays: near moving objects, including those that stand, or "
          "everywhere; elsewhere it is one ray");
  f.check(c.sub_rays % 2 == 1, "sub_rays",
          "expected an odd number, got " + std::to_string(c.sub_rays));
}

template <class Fields>
void visit(Fields& f, ReturnsConfig& c) {
  f.field("min_range_m", c.min_range_m, "shortest range of a return",
          between(0, kLongestMinRange_m));
  f.field("max_range_m", c.max_range_m, "longest range of a return",
          required(positive(kLongestRange_m)));
  f.field("range_accuracy_m", c.range_accuracy_m,
          "standard deviation of the range of the weakest returns; strong returns have less",
          between(0, 10));
  f.field("drop_off", c.drop_off, "random loss of points, by the model of CARLA");
  f.field("detection", c.detection, "detection by received power");
  f.field("beam", c.beam, "beam with a divergence");
  f.field("echoes", c.echoes, "echoes of a ray that become points");
  f.check(c.detection || !c.echoes || c.echoes->mode == EchoMode::kStrongest, "echoes",
          "expected mode strongest, because returns.detection is missing, got another mode");
  f.check(c.max_range_m > c.min_range_m, "max_range_m",
          "expected above min_range_m, got min_range_m or less");
}

template void visit(config::FieldReader&, ReturnsConfig&);
template void visit(config::FieldWriter&, ReturnsConfig&);
template void visit(config::FieldLister&, ReturnsConfig&);

}  // namespace infrasim
