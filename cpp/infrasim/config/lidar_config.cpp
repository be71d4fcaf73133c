#include "infrasim/config/lidar_config.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>

#include "infrasim/config/lidar_keys.h"
#include "infrasim/config/lidar_tables.h"
#include "infrasim/core/errors.h"
#include "infrasim/core/rng.h"

namespace infrasim {

using config::between;
using config::required;

template <class Fields>
void visit(Fields& f, PriceConfig& c) {
  f.field("low", c.low, "lowest price, in US dollars", required(between(0, 1e7)));
  f.field("high", c.high, "highest price, in US dollars", required(between(0, 1e7)));
  f.field("source", c.source, "source of the price", required());
  f.field("date", c.date, "date of the price", required());
  f.check(c.high >= c.low, "high", "expected low or more, got less");
}

namespace {

/// One entry of a bundle: either the file of another LiDAR, or all keys of a unit, as in the text
/// of dump_lidar.
struct BundleEntry {
  std::optional<std::string> lidar;
  double yaw_deg = 0;
  double pitch_deg = 0;
  std::optional<PatternConfig> pattern;
  std::optional<ReturnsConfig> returns;
  config::KeyPlace lidar_key = {};
};

/// The keys of a LiDAR file: either one unit or a bundle.
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
  f.here(c.lidar_key, "lidar");
  f.field("yaw_deg", c.yaw_deg, "yaw on the mount, positive to the left", between(-360, 360));
  f.field("pitch_deg", c.pitch_deg, "pitch; positive values point the LiDAR down",
          between(-90, 90));
  // the key list has these keys only outside bundles
  if constexpr (!std::is_same_v<Fields, config::FieldLister>) {
    f.field("pattern", c.pattern, "scan pattern: directions and times of the rays");
    f.field("returns", c.returns, "return model: which ray hits become points");
  }
  const bool file = c.lidar && !c.lidar->empty() && !c.pattern && !c.returns;
  const bool whole = !c.lidar && c.pattern && c.returns;
  f.check(file || whole, "lidar",
          "expected a LiDAR file, or pattern and returns in its place, got "
          "neither or both");
}

/// Returns whether the keys form a valid bundle. A bundle of files must not have a price, because
/// its price is the sum of the files' prices. A bundle that has all keys of its units must have a
/// price.
bool is_bundle(const LidarFile& c) {
  const auto files =
      std::ranges::count_if(c.bundle, [](const BundleEntry& e) { return e.lidar.has_value(); });
  const bool has_price = c.price_usd && files == 0;
  const bool sum = !c.price_usd && files == std::ssize(c.bundle);
  return !c.pattern && !c.returns && !c.bundle.empty() && (has_price || sum);
}

template <class Fields>
void visit(Fields& f, LidarFile& c) {
  f.field("name", c.name, "name of the LiDAR and of the folder of its frames", required());
  f.check(c.name.find_first_of("/\\,\"\n") == std::string::npos && config::begins_as_name(c.name),
          "name",
          "expected a name without /, \\, comma, quote and newline that begins with a letter, a "
          "digit or _, got '" +
              c.name + "'");
  f.field("model", c.model, "vendor and product");
  f.field("price_usd", c.price_usd, "price of one unit");
  f.field("pattern", c.pattern, "scan pattern: directions and times of the rays");
  f.field("returns", c.returns, "return model: which ray hits become points");
  f.field(
      "bundle", c.bundle,
      "several LiDARs that count as one; in a resolved file, pattern and returns replace lidar");
  const bool single = c.pattern && c.returns && c.price_usd && c.bundle.empty();
  f.check(single || is_bundle(c), "bundle",
          "expected pattern, returns and price_usd; or only a bundle of LiDAR files; or price_usd "
          "and a bundle of entries with pattern and returns; got another combination of keys");
}

/// Returns the tree of a LiDAR file, merged with the keys of one preset.
config::Tree preset_tree(const std::filesystem::path& file, const std::string& preset) {
  config::Tree tree = config::read_tree(file);
  const auto presets = config::take_presets(tree);
  if (!presets) {
    if (preset.find_first_of(",\"\n") != std::string::npos)
      config::fail(tree.place, "preset",
                   "expected a name without comma, quote and newline, got '" + preset + "'");
    return tree;
  }
  const config::Tree* chosen = presets->find(preset);
  if (chosen == nullptr)
    config::fail(presets->place, "presets",
                 "expected " + listed(presets->keys) + ", got unknown preset '" + preset + "'");
  config::expect_map(*chosen, "presets." + preset);
  return config::merged(tree, *chosen);
}

void resolve_channels(const std::filesystem::path& folder, ChannelsConfig& c) {
  if (!c.file.empty())
    c.table =
        config::read_named(c.file_key, [&] { return config::read_channels(folder / c.file); });
  if (c.count == 1)
    c.table.push_back({.elevation_deg = c.upper_deg.value_or(c.lower_deg.value_or(0))});
  const double upper = c.upper_deg.value_or(0), lower = c.lower_deg.value_or(0);
  for (int i = 0; c.count > 1 && i < c.count; ++i)
    c.table.push_back({.elevation_deg = upper - i * ((upper - lower) / (c.count - 1))});
  c = ChannelsConfig{.file = "", .count = 0, .upper_deg = 0, .lower_deg = 0, .table = c.table};
}

/// Sets the rays per second of a table of directions, if the file does not give them. A table with
/// times then starts again one mean time step after its last row.
void resolve_rate(const std::filesystem::path& file, TableConfig& c) {
  const auto rows = static_cast<double>(c.directions.size());
  const double last_s = c.times_s.empty() ? 0 : c.times_s.back();
  if (c.rays_per_s == 0 && last_s > 0) c.rays_per_s = (rows - 1) / last_s;
  if (c.rays_per_s < kFewestPerSecond || c.rays_per_s > kMostRaysPerSecond)
    config::fail({file.string()}, "rays_per_s",
                 "expected " + config::number_text(kFewestPerSecond) + " to " +
                     config::number_text(kMostRaysPerSecond) + ", got " +
                     (c.rays_per_s == 0 ? "no value, and a table without times"
                                        : config::number_text(c.rays_per_s)));
  if (last_s > 0 && last_s >= rows / c.rays_per_s)
    config::fail({file.string()}, "rays_per_s",
                 "expected below " + config::number_text(rows / last_s) + ", as the last row is " +
                     config::number_text(last_s) + " s after the first, got " +
                     config::number_text(c.rays_per_s));
}

void resolve_table(const std::filesystem::path& file, TableConfig& c) {
  config::FiringTable table = config::read_named(
      c.file_key, [&] { return config::read_firing_table(file.parent_path() / c.file); });
  c.directions = std::move(table.directions);
  c.times_s = std::move(table.times_s);
  resolve_rate(file, c);
  std::uint64_t hash = c.directions.size();
  for (const Vec2& d : c.directions)
    for (const double v : {d.x, d.y}) hash = mix64(hash ^ std::bit_cast<std::uint64_t>(v));
  for (const double t : c.times_s) hash = mix64(hash ^ std::bit_cast<std::uint64_t>(t));
  const std::string digest = std::to_string(hash);
  if (!c.digest.empty() && c.digest != digest)
    config::fail({file.string()}, "digest", "expected " + digest + ", got " + c.digest);
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
                     "expected below " + config::number_text(column_us) +
                         ", the time of a column, got " + config::number_text(c.fire_time_us));
    if (const int columns = columns_per_group(spinning); columns > kMostColumnStep)
      config::fail({file.string()}, "column_step",
                   "expected steps with a least common multiple of at most " +
                       std::to_string(kMostColumnStep) + ", got " + std::to_string(columns));
  }
  if (pattern.table) resolve_table(file, *pattern.table);
}

// maximum number of lasers of a LiDAR, because ring numbers have 16 bits
constexpr double kMaxLasers = 65535;

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
                   "expected at most " + config::number_text(most) + " in one LiDAR, got " +
                       config::number_text(value));
  };
  limit("(lasers)", static_cast<double>(lasers), kMaxLasers);
  limit("(rays per second)", rays, kMostRaysPerSecond);
}

/// Makes a unit from the keys of a single LiDAR or of an entry of a bundle.
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

/// Returns the unit that a file of a bundle describes, and adds its price to `sum`.
LidarUnit unit_of_file(const std::filesystem::path& file, const BundleEntry& entry,
                       const std::string& preset, PriceConfig& sum) {
  const std::string& part = *entry.lidar;
  const std::filesystem::path part_file = file.parent_path() / part;
  const auto keys = config::read_struct<LidarFile>(
      config::read_named(entry.lidar_key, [&] { return preset_tree(part_file, preset); }));
  if (!keys.bundle.empty())
    config::fail({file.string()}, "bundle",
                 "expected files of single LiDARs, got the file of another bundle");
  add_price(*keys.price_usd, sum);
  LidarUnit unit = unit_of(part_file, keys);
  // The path of the table becomes relative to the file of the bundle.
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
    LidarUnit& unit = out.units.emplace_back(
        entry.lidar ? unit_of_file(file, entry, preset, out.price_usd) : unit_of(file, entry));
    unit.yaw_deg = entry.yaw_deg;
    unit.pitch_deg = entry.pitch_deg;
    if (period_s(unit.pattern) != period_s(out.units.front().pattern))
      config::fail({file.string()}, "bundle",
                   "expected units with the same frame period, got " +
                       config::number_text(period_s(out.units.front().pattern)) + " s and " +
                       config::number_text(period_s(unit.pattern)) + " s");
  }
  return out;
}

LidarFile keys_of(const LidarConfig& lidar) {
  LidarFile keys{lidar.name, lidar.model, std::nullopt, std::nullopt, std::nullopt, {}};
  const LidarUnit& first = lidar.units.front();
  keys.price_usd = lidar.price_usd;
  if (lidar.units.size() == 1 && first.yaw_deg == 0 && first.pitch_deg == 0) {
    keys.pattern = first.pattern;
    keys.returns = first.returns;
  } else {
    for (const LidarUnit& u : lidar.units)
      keys.bundle.push_back({std::nullopt, u.yaw_deg, u.pitch_deg, u.pattern, u.returns});
  }
  return keys;
}

/// Returns the canonical text of a LiDAR's keys. The price of several units is left out, because
/// files of earlier versions do not have it.
std::string canonical_of(LidarFile keys) {
  if (keys.bundle.size() > 1) keys.price_usd.reset();
  return config::canonical_text(keys);
}

}  // namespace

double rays_per_s(const PatternConfig& pattern) {
  const auto lasers = static_cast<double>(lasers_of(pattern));
  if (pattern.spinning) {
    double rays_per_column = 0;
    for (const Channel& c : pattern.spinning->channels.table)
      rays_per_column += 1.0 / c.column_step;
    return rays_per_column * columns_per_s(*pattern.spinning);
  }
  return pattern.prisms ? lasers * pattern.prisms->steps_per_s : pattern.table->rays_per_s;
}

double period_s(const PatternConfig& pattern) {
  if (pattern.spinning) return 1 / pattern.spinning->rate_hz;
  return pattern.prisms ? pattern.prisms->period_s : pattern.table->period_s;
}

double period_s(const LidarConfig& lidar) { return period_s(lidar.units.front().pattern); }

double period_s(std::span<const LidarConfig> lidars) {
  if (lidars.empty()) return kUsualPeriod_s;
  const LidarConfig& first = lidars.front();
  for (const LidarConfig& lidar : lidars)
    if (period_s(lidar) != period_s(first)) {
      const auto text = [](const LidarConfig& one) {
        return one.name + " with " + config::number_text(period_s(one)) + " s";
      };
      throw ConfigError("lidars: expected one frame period in a run, got " + text(first) + " and " +
                        text(lidar));
    }
  return period_s(first);
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

std::string dump_lidar(const LidarConfig& lidar) { return config::dump_struct(keys_of(lidar)); }

std::string canonical_lidar(const LidarConfig& lidar) { return canonical_of(keys_of(lidar)); }

std::string canonical_lidar(const config::Tree& resolved) {
  return canonical_of(config::read_written<LidarFile>(resolved));
}

std::string config::list_lidar_keys() { return list_keys<LidarFile>(); }

}  // namespace infrasim
