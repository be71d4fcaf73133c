#include "infrasim/config/lidar_config.h"

#include <cstring>

#include "infrasim/config/fields.h"
#include "infrasim/config/key_list.h"
#include "infrasim/config/lidar_tables.h"
#include "infrasim/core/rng.h"

namespace infrasim {

using config::at_least_one;
using config::between;
using config::positive;
using config::required;

namespace {

// A frame is a tenth of a second: at least one ray, and no more than memory holds.
constexpr double kFewestPerSecond = 10;
constexpr double kMostRaysPerSecond = 1e8;
// Each ray is traced through each prism, about 0.1 us; a Horizon has 720,000 passages.
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
  f.field("elevation_deg", c.elevation_deg, "above the horizon", required(between(-90, 90)));
  f.field("azimuth_offset_deg", c.azimuth_offset_deg, "in the sense of rotation",
          between(-180, 180));
  f.field("fire_time_us", c.fire_time_us, "after the start of its column", between(0, 1e6));
}

template <class Fields>
void visit(Fields& f, ChannelsConfig& c) {
  f.field("count", c.count, "evenly spaced channels", between(0, 65535));
  f.field("upper_deg", c.upper_deg, "elevation of the first", between(-90, 90));
  f.field("lower_deg", c.lower_deg, "elevation of the last", between(-90, 90));
  f.field("file", c.file, "table of channels, relative to this file");
  f.field("table", c.table, "channels, in the order of their points in a column");
  const int ways = (c.count > 0) + !c.file.empty() + !c.table.empty();
  f.check(ways == 1, "count", "found none or several, allowed one of count, file, table");
  f.check(c.count == 0 || c.upper_deg > c.lower_deg, "upper_deg",
          "found it not above lower_deg, allowed above");
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
  f.field("phase", c.phase, "locked: at time 0 it stands at seam_deg; free: at a seeded draw");
  f.field("seam_deg", c.cut_angle_deg, "azimuth in the unit's own frame at which a turn begins",
          between(-360, 360));
  f.field("azimuth_step_deg", c.azimuth_step_deg, "between two columns; or columns_per_turn",
          positive(90));
  f.field("columns_per_turn", c.columns_per_turn, "the step's exact form, such as 1800 or 8125/4",
          between(4, 1e9));
  f.field("channels", c.channels, "lasers", required());
  const char* step = c.columns_per_turn ? "columns_per_turn" : "azimuth_step_deg";
  const bool one = c.azimuth_step_deg.has_value() != c.columns_per_turn.has_value();
  f.check(one, step, "found both or neither, allowed azimuth_step_deg or columns_per_turn");
  const double columns = one ? columns_per_s(c) : kFewestPerSecond;
  f.check(columns >= kFewestPerSecond && columns <= kMostRaysPerSecond,
          columns < kFewestPerSecond ? "rate_hz" : step,
          "found " + config::number_text(columns) + " columns a second, allowed " +
              config::number_text(kFewestPerSecond) + " to " +
              config::number_text(kMostRaysPerSecond));
}

template <class Fields>
void visit(Fields& f, PrismConfig& c) {
  f.field("rpm", c.rpm, "turns per minute, signed", required(between(-1e6, 1e6)));
  f.field("angle_deg", c.angle_deg, "between its faces, signed", required(between(-45, 45)));
  f.field("refractive_index", c.refractive_index, "of its glass", required(between(1, 4)));
  f.field("faces", c.faces, "tilted_first or flat_first, as the light goes", required());
  f.field("phase_deg", c.phase_deg, "at time 0", between(-360, 360));
}

template <class Fields>
void visit(Fields& f, PrismsConfig& c) {
  f.field("steps_per_s", c.steps_per_s, "firings per second",
          required(between(kFewestPerSecond, 1e7)));
  f.field("phase", c.phase, "free: a seeded draw of the start; locked: first_step at time 0");
  f.field("first_step", c.first_step, "index of the firing at time 0", between(0, 1e6));
  f.field("focal_length", c.focal_length, "in the unit of laser_offsets", positive());
  f.field("laser_offsets", c.laser_offsets, "lasers fired at once, from the top", at_least_one());
  f.field("wedges", c.prisms, "prisms, as the light goes", at_least_one());
  const double passages = c.steps_per_s * static_cast<double>(c.laser_offsets.size()) *
                          static_cast<double>(c.prisms.size());
  f.check(passages <= kMostPassagesPerSecond, "steps_per_s",
          "found " + config::number_text(passages) +
              " passages of light through wedges a second (steps, lasers and wedges), allowed " +
              config::number_text(kMostPassagesPerSecond));
}

template <class Fields>
void visit(Fields& f, TableConfig& c) {
  f.field("file", c.file, ".npy or .csv of azimuth, elevation and maybe time", required());
  f.field("rays_per_s", c.rays_per_s, "rays per second; needed for a table without times",
          between(kFewestPerSecond, kMostRaysPerSecond));
  f.field("phase", c.phase, "free: a seeded draw of the start; locked: the first row at time 0");
  f.field("digest", c.digest, "of the rows; written by a run, checked when given");
}

template <class Fields>
void visit(Fields& f, PatternConfig& c) {
  f.field("spinning", c.spinning, "columns of channels around the circle");
  f.field("wedges", c.prisms, "rotating prisms (Livox)");
  f.field("table", c.table, "a list of directions");
  f.check(c.spinning.has_value() + c.prisms.has_value() + c.table.has_value() == 1, "spinning",
          "found none or several, allowed one of spinning, wedges, table");
}

template <class Fields>
void visit(Fields& f, DropOffConfig& c) {
  f.field("general_rate", c.general_rate, "share lost at random", required(between(0, 1)));
  f.field("intensity_limit", c.intensity_limit, "kept above this intensity", required(positive(1)));
  f.field("zero_intensity_rate", c.zero_intensity_rate, "share lost at intensity 0",
          required(between(0, 1)));
}

template <class Fields>
void visit(Fields& f, PublishedRange& c) {
  f.field("range_m", c.range_m, "as the vendor publishes it", required(positive(2000)));
  f.field("reflectance", c.reflectance, "of its target", required(positive(1)));
  f.field("sunlight_klux", c.sunlight_klux, "on its target; 0 at night", between(0, 200));
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

/// Two ranges of which the one of a brighter target, or in less light, is the shorter; nothing if
/// there are none.
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
          "range on a 10 % target in the sun (100 klx)", required(positive(2000)));
  f.field("further_ranges", c.further_ranges,
          "on other targets or in other light; without one the law is an assumption");
  f.field("steepness", c.steepness, "of detection over signal-to-noise ratio", positive(1000));
  const std::string both = contradiction(c);
  f.check(both.empty(), "further_ranges",
          "expected ranges that grow with reflectance and shrink with sunlight, got " + both);
}

template <class Fields>
void visit(Fields& f, BeamConfig& c) {
  f.field("vertical_deg", c.vertical_deg, "full width", required(between(0, 10)));
  f.field("horizontal_deg", c.horizontal_deg, "full width", required(between(0, 10)));
  f.field("sub_rays", c.sub_rays, "rays along its longer side", between(2, 64));
}

template <class Fields>
void visit(Fields& f, ReturnsConfig& c) {
  f.field("min_range_m", c.min_range_m, "blind zone", between(0, 1000));
  f.field("max_range_m", c.max_range_m, "no return beyond", required(positive(kLongestRange_m)));
  f.field("range_accuracy_m", c.range_accuracy_m,
          "1 sigma of the faintest returns; bright ones have less", between(0, 10));
  f.field("drop_off", c.drop_off, "random loss of points, as CARLA has it");
  f.field("detection", c.detection, "detection by received power");
  f.field("beam", c.beam, "beam wider than a ray");
  f.check(c.max_range_m > c.min_range_m, "max_range_m",
          "found it not above min_range_m, allowed above");
}

template <class Fields>
void visit(Fields& f, PriceConfig& c) {
  f.field("low", c.low, "US dollars", required(between(0, 1e7)));
  f.field("high", c.high, "US dollars", required(between(0, 1e7)));
  f.field("source", c.source, "who says so", required());
  f.field("date", c.date, "when", required());
  f.check(c.high >= c.low, "high", "found it below low, allowed low or more");
}

namespace {

/// One entry of a bundle: another LiDAR's file, or (in a resolved dump) the unit itself.
struct BundleEntry {
  std::optional<std::string> lidar;
  double yaw_deg = 0;
  double pitch_deg = 0;
  std::optional<PatternConfig> pattern;
  std::optional<ReturnsConfig> returns;
};

/// The keys of a LiDAR file; either one unit or a bundle.
struct LidarFile {
  std::string name;
  std::string model;
  std::optional<PriceConfig> price_usd;
  std::optional<PatternConfig> pattern;
  std::optional<ReturnsConfig> returns;
  std::vector<BundleEntry> bundle;
};

template <class Fields>
void visit(Fields& f, BundleEntry& c) {
  f.field("lidar", c.lidar, "LiDAR file, relative to this one");
  f.field("yaw_deg", c.yaw_deg, "turned to the left on the mount", between(-360, 360));
  f.field("pitch_deg", c.pitch_deg, "positive looks down", between(-90, 90));
  if constexpr (!std::is_same_v<Fields, config::FieldLister>) {  // listed once, outside of bundles
    f.field("pattern", c.pattern, "directions and times of its rays");
    f.field("returns", c.returns, "which hits become points");
  }
  const bool file = c.lidar && !c.lidar->empty() && !c.pattern && !c.returns;
  const bool whole = !c.lidar && c.pattern && c.returns;
  f.check(file || whole, "lidar",
          "found neither or both, allowed a LiDAR file, or pattern and returns in its place");
}

/// A bundle of files has the sum of their prices; one of whole units has its own.
bool is_bundle(const LidarFile& c) {
  const auto files =
      std::ranges::count_if(c.bundle, [](const BundleEntry& e) { return e.lidar.has_value(); });
  const bool has_price = c.price_usd && files == 0;
  const bool sum = !c.price_usd && files == std::ssize(c.bundle);
  return !c.pattern && !c.returns && !c.bundle.empty() && (has_price || sum);
}

template <class Fields>
void visit(Fields& f, LidarFile& c) {
  f.field("name", c.name, "name, and folder of its frames", required());
  f.check(c.name.find_first_of("/\\,\"\n") == std::string::npos && config::begins_as_name(c.name),
          "name",
          "found '" + c.name +
              "', allowed a name that can be a folder and a word of a table, and " +
              "begins with a letter, a digit or _");
  f.field("model", c.model, "vendor and product");
  f.field("price_usd", c.price_usd, "price of one unit");
  f.field("pattern", c.pattern, "directions and times of its rays");
  f.field("returns", c.returns, "which hits become points");
  f.field("bundle", c.bundle,
          "several LiDARs cast as one; resolved, with pattern and returns in place of lidar");
  const bool single = c.pattern && c.returns && c.price_usd && c.bundle.empty();
  f.check(single || is_bundle(c), "bundle",
          "found an incomplete LiDAR, allowed pattern, returns and price_usd, or bundle alone, or "
          "price_usd and a bundle without files");
}

/// The file's tree with the named preset merged in.
config::Tree preset_tree(const std::filesystem::path& file, const std::string& preset) {
  config::Tree tree = config::read_tree(file);
  const auto presets = config::take_presets(tree);
  if (!presets) {
    if (preset.find_first_of(",\"\n") != std::string::npos)
      config::fail(tree.place, "preset", "found '" + preset + "', allowed a word of a table");
    return tree;
  }
  const config::Tree* chosen = presets->find(preset);
  if (chosen == nullptr) {
    std::string names;
    for (const std::string& name : presets->keys) names += (names.empty() ? "" : ", ") + name;
    config::fail(presets->place, "presets", "found no preset '" + preset + "', allowed " + names);
  }
  config::expect_map(*chosen, "presets." + preset);
  return config::merged(tree, *chosen);
}

void resolve_channels(const std::filesystem::path& folder, ChannelsConfig& c) {
  if (!c.file.empty()) c.table = config::read_channels(folder / c.file);
  for (int i = 0; i < c.count; ++i) {
    const double step = c.count > 1 ? (c.upper_deg - c.lower_deg) / (c.count - 1) : 0;
    c.table.push_back({c.upper_deg - i * step, 0, 0});
  }
  c = ChannelsConfig{.file = "", .count = 0, .upper_deg = 0, .lower_deg = 0, .table = c.table};
}

/// A table with times begins again a mean step after its last row, or as `rays_per_s` says.
void resolve_rate(const std::filesystem::path& file, TableConfig& c) {
  const auto rows = static_cast<double>(c.directions.size());
  const double last_s = c.times_s.empty() ? 0 : c.times_s.back();
  if (c.rays_per_s == 0 && last_s > 0) c.rays_per_s = (rows - 1) / last_s;
  if (c.rays_per_s < kFewestPerSecond || c.rays_per_s > kMostRaysPerSecond)
    config::fail(
        {file.string()}, "rays_per_s",
        "expected " + config::number_text(kFewestPerSecond) + " to " +
            config::number_text(kMostRaysPerSecond) + ", got " +
            (c.rays_per_s == 0 ? "none, and no times" : config::number_text(c.rays_per_s)));
  if (last_s > 0 && last_s >= rows / c.rays_per_s)
    config::fail({file.string()}, "rays_per_s",
                 "expected below " + config::number_text(rows / last_s) + ", as the last row is " +
                     config::number_text(last_s) + " s after the first, got " +
                     config::number_text(c.rays_per_s));
}

void resolve_table(const std::filesystem::path& file, TableConfig& c) {
  config::FiringTable table = config::read_firing_table(file.parent_path() / c.file);
  c.directions = std::move(table.directions);
  c.times_s = std::move(table.times_s);
  resolve_rate(file, c);
  std::uint64_t hash = c.directions.size();
  for (const Vec2& d : c.directions)
    for (const double v : {d.x, d.y}) hash = mix64(hash ^ std::bit_cast<std::uint64_t>(v));
  for (const double t : c.times_s) hash = mix64(hash ^ std::bit_cast<std::uint64_t>(t));
  const std::string digest = std::to_string(hash);
  if (!c.digest.empty() && c.digest != digest)
    config::fail({file.string()}, "digest", "found " + c.digest + ", allowed " + digest);
  c.digest = digest;
}

void resolve_files(const std::filesystem::path& file, PatternConfig& pattern) {
  if (pattern.spinning) {
    SpinningConfig& spinning = *pattern.spinning;
    resolve_channels(file.parent_path(), spinning.channels);
    const double column_us = 1e6 / columns_per_s(spinning);
    for (const Channel& c : spinning.channels.table)
      if (c.fire_time_us >= column_us)
        config::fail({file.string()}, "fire_time_us",
                     "found " + config::number_text(c.fire_time_us) + ", allowed below " +
                         config::number_text(column_us) + ", the time of a column");
  }
  if (pattern.table) resolve_table(file, *pattern.table);
}

constexpr double kMaxLasers = 65535;  // ring numbers have 16 bits

std::size_t lasers_of(const PatternConfig& pattern) {
  if (pattern.spinning) return pattern.spinning->channels.table.size();
  return pattern.prisms ? pattern.prisms->laser_offsets.size() : 1;
}

void check_size(const std::filesystem::path& file, const LidarConfig& lidar) {
  std::size_t lasers = 0;
  double rays = 0;
  for (const LidarUnit& unit : lidar.units) {
    lasers += lasers_of(unit.pattern);
    rays += rays_per_s(unit.pattern);
  }
  const auto limit = [&](const char* key, double value, double most) {
    if (value > most)
      config::fail({file.string()}, key,
                   "found " + config::number_text(value) + ", allowed at most " +
                       config::number_text(most) + " in one LiDAR");
  };
  limit("(lasers)", static_cast<double>(lasers), kMaxLasers);
  limit("(rays per second)", rays, kMostRaysPerSecond);
}

/// Works on a single LiDAR's keys and on a whole entry of a bundle.
template <class Keys>
LidarUnit unit_of(const std::filesystem::path& file, const Keys& keys) {
  LidarUnit unit{.yaw_deg = 0, .pitch_deg = 0, .pattern = *keys.pattern, .returns = *keys.returns};
  resolve_files(file, unit.pattern);
  return unit;
}

void add_price(const PriceConfig& part, PriceConfig& sum) {
  sum.low += part.low;
  sum.high += part.high;
  sum.source = part.source;
  sum.date = part.date;
}

/// The unit that a file of a bundle describes; its price is added to the sum.
LidarUnit unit_of_file(const std::filesystem::path& file, const std::string& part,
                       const std::string& preset, PriceConfig& sum) {
  const std::filesystem::path part_file = file.parent_path() / part;
  const auto keys = config::read_struct<LidarFile>(preset_tree(part_file, preset));
  if (!keys.bundle.empty())
    config::fail({file.string()}, "bundle", "found a bundle in it, allowed single LiDARs");
  add_price(*keys.price_usd, sum);
  LidarUnit unit = unit_of(part_file, keys);
  // From here on the path is relative to the bundle.
  if (auto& table = unit.pattern.table)
    table->file = (std::filesystem::path(part).parent_path() / table->file).string();
  return unit;
}

LidarConfig lidar_of(const std::filesystem::path& file, const LidarFile& keys,
                     const std::string& preset) {
  LidarConfig out{keys.name, keys.model, preset, {}, {}};
  if (keys.price_usd) out.price_usd = *keys.price_usd;
  if (keys.bundle.empty()) out.units.push_back(unit_of(file, keys));
  for (const BundleEntry& entry : keys.bundle) {
    LidarUnit& unit =
        out.units.emplace_back(entry.lidar ? unit_of_file(file, *entry.lidar, preset, out.price_usd)
                                           : unit_of(file, entry));
    unit.yaw_deg = entry.yaw_deg;
    unit.pitch_deg = entry.pitch_deg;
  }
  return out;
}

}  // namespace

double rays_per_s(const PatternConfig& pattern) {
  const auto lasers = static_cast<double>(lasers_of(pattern));
  if (pattern.spinning) return lasers * columns_per_s(*pattern.spinning);
  return pattern.prisms ? lasers * pattern.prisms->steps_per_s : pattern.table->rays_per_s;
}

LidarConfig read_lidar(const std::filesystem::path& file, const std::string& preset) {
  const auto keys = config::read_struct<LidarFile>(preset_tree(file, preset));
  LidarConfig lidar = lidar_of(file, keys, preset);
  check_size(file, lidar);
  return lidar;
}

std::vector<std::string> preset_names(const std::filesystem::path& file) {
  const config::Tree tree = config::read_tree(file);
  const config::Tree* presets = tree.find("presets");
  return presets == nullptr ? std::vector<std::string>{} : presets->keys;
}

namespace {

LidarFile keys_of(const LidarConfig& lidar) {
  LidarFile keys{lidar.name, lidar.model, std::nullopt, std::nullopt, std::nullopt, {}};
  const LidarUnit& first = lidar.units.front();
  const bool alone = lidar.units.size() == 1;
  if (alone) keys.price_usd = lidar.price_usd;
  if (alone && first.yaw_deg == 0 && first.pitch_deg == 0) {
    keys.pattern = first.pattern;
    keys.returns = first.returns;
  } else {
    for (const LidarUnit& u : lidar.units)
      keys.bundle.push_back({std::nullopt, u.yaw_deg, u.pitch_deg, u.pattern, u.returns});
  }
  return keys;
}

}  // namespace

std::string dump_lidar(const LidarConfig& lidar) { return config::dump_struct(keys_of(lidar)); }

std::string canonical_lidar(const LidarConfig& lidar) {
  return config::canonical_text(keys_of(lidar));
}

std::string canonical_lidar(const config::Tree& resolved) {
  return config::canonical_text(config::read_struct<LidarFile>(resolved));
}

std::string config::list_lidar_keys() { return list_keys<LidarFile>(); }

}  // namespace infrasim
