#include "infrasim/pipeline/static_layer_file.h"

#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <utility>

#include "infrasim/config/fields.h"
#include "infrasim/config/lidar_config.h"
#include "infrasim/core/classes.h"
#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/core/numbers.h"
#include "infrasim/core/rng.h"

namespace infrasim {

static_assert(std::endian::native == std::endian::little, "the file is little-endian");

namespace {

constexpr std::string_view kLayerMagic = "infrasim-static-layer 2\n";
constexpr std::string_view kFirstMagic = "infrasim-static-layer 1\n";  // first line in version 0.3
constexpr std::array kMountKeys{"x_m", "y_m", "z_m", "yaw_deg", "pitch_deg", "roll_deg"};
constexpr std::int32_t kMostUnits = 1024, kMostGroups = 1 << 30, kMostMembers = 65535;
constexpr std::size_t kRayBytes = 2 * sizeof(float) + sizeof(std::uint16_t);

template <class T>
void put(std::string& bytes, const T& value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

template <class T>
void put_all(std::string& bytes, const std::vector<T>& column) {
  bytes.append(reinterpret_cast<const char*>(column.data()), column.size() * sizeof(T));
}

/// Reads values one after the other from the bytes of a file.
class Reader {
 public:
  Reader(std::string_view bytes, std::string name) : bytes_(bytes), name_(std::move(name)) {}

  std::size_t left() const { return bytes_.size() - at_; }
  void skip(std::size_t n) { at_ += n; }

  template <class T>
  T take() {
    T value;
    need(sizeof value);
    std::memcpy(&value, bytes_.data() + at_, sizeof value);
    at_ += sizeof value;
    return value;
  }
  std::int32_t take_count(const char* what, std::int32_t most) {
    const auto n = take<std::int32_t>();
    if (n < 1 || n > most)
      fail(at_ - sizeof n, std::string(what) + ": expected 1 to " + std::to_string(most) +
                               ", got " + std::to_string(n));
    return n;
  }
  /// Reads a column of n values, which must satisfy `allowed`.
  template <class T, class Allowed>
  std::vector<T> take_column(std::size_t n, const char* what, const Allowed& allowed,
                             const std::string& words) {
    need(n * sizeof(T));
    std::vector<T> column(n);
    std::memcpy(column.data(), bytes_.data() + at_, n * sizeof(T));
    for (std::size_t i = 0; i < n; ++i)
      if (!allowed(column[i]))
        fail(at_ + i * sizeof(T),
             std::string(what) + ": expected " + words + ", got " + config::number_text(column[i]));
    at_ += n * sizeof(T);
    return column;
  }
  void need(std::size_t n) const {
    if (n > left())
      fail(bytes_.size(),
           "expected " + std::to_string(n - left()) + " bytes more, got the end of the file");
  }
  [[noreturn]] void fail(std::size_t byte, const std::string& message) const {
    throw ConfigError(name_ + ": byte " + std::to_string(byte) + ": " + message);
  }
  [[noreturn]] void fail_here(const std::string& message) const { fail(at_, message); }

 private:
  std::string_view bytes_;
  std::string name_;
  std::size_t at_ = 0;
};

std::array<double, 6> values_of(const MountConfig& mount) {
  return {mount.x_m, mount.y_m, mount.z_m, mount.yaw_deg, mount.pitch_deg, mount.roll_deg};
}

LayerOrigin take_origin(Reader& reader) {
  LayerOrigin origin;
  for (std::size_t i = 0; i < kMountKeys.size(); ++i) {
    origin.mount[i] = reader.take<double>();
    if (!std::isfinite(origin.mount[i]))
      reader.fail_here(std::string(kMountKeys[i]) + ": expected a finite number, got " +
                       config::number_text(origin.mount[i]));
  }
  origin.scene = reader.take<std::uint64_t>();
  return origin;
}

StaticHits take_header(Reader& reader) {
  StaticHits unit;
  unit.directions = reader.take<std::uint64_t>();
  unit.groups = reader.take_count("groups", kMostGroups);
  unit.group_size = reader.take_count("rays of a group", kMostMembers);
  unit.max_range_m = reader.take<float>();
  if (!(unit.max_range_m > 0 && unit.max_range_m <= static_cast<float>(kLongestRange_m)))
    reader.fail_here("max_range_m: expected above 0, up to " +
                     config::number_text(kLongestRange_m) + ", got " +
                     config::number_text(unit.max_range_m));
  return unit;
}

void take_hits(Reader& reader, StaticHits& unit) {
  const std::size_t n = unit.rays();
  reader.need(n * kRayBytes);
  const float most = unit.max_range_m;
  unit.range_m = reader.take_column<float>(
      n, "range_m", [&](float v) { return (v >= 0 && v <= most) || v == kInf; },
      "0 to " + config::number_text(most) + ", or inf");
  unit.gain = reader.take_column<float>(
      n, "cos_incidence", [](float v) { return v >= 0 && v <= 1; }, "0 to 1");
  constexpr auto kLast = static_cast<std::uint16_t>(Class::kRecorded);
  unit.class_id = reader.take_column<std::uint16_t>(
      n, "class", [](std::uint16_t v) { return v <= kLast; }, "0 to " + std::to_string(kLast));
}

std::string size_text(const StaticHits& unit) {
  return std::to_string(unit.groups) + " groups of " + std::to_string(unit.group_size) + " rays";
}

}  // namespace

LayerOrigin layer_origin(const SceneConfig& scene, const TriangleMesh& background) {
  std::uint64_t hash = 0;
  for (const std::uint64_t part : {hash_all(background.vertices), hash_all(background.triangles),
                                   hash_all(background.class_id)})
    hash = mix64(hash ^ part);
  return {values_of(scene.mounts.begin()->second), hash};
}

std::string static_layer_to_bytes(const LayerOrigin& origin, std::span<const StaticHits> units) {
  std::string bytes(kLayerMagic);
  put(bytes, origin.mount);
  put(bytes, origin.scene);
  put(bytes, static_cast<std::int32_t>(units.size()));
  for (const StaticHits& unit : units) {
    put(bytes, unit.directions);
    put(bytes, static_cast<std::int32_t>(unit.groups));
    put(bytes, static_cast<std::int32_t>(unit.group_size));
    put(bytes, unit.max_range_m);
  }
  for (const StaticHits& unit : units) {
    put_all(bytes, unit.range_m);
    put_all(bytes, unit.gain);
    put_all(bytes, unit.class_id);
  }
  return bytes;
}

StaticLayerFile static_layer_from_bytes(std::string_view bytes, const std::string& name) {
  Reader reader(bytes, name);
  if (bytes.starts_with(kFirstMagic))
    reader.fail_here(
        "expected a static layer of version 2, got version 1 of infrasim 0.3, which does not have "
        "the mount: write it again with infrasim static");
  if (!bytes.starts_with(kLayerMagic))
    reader.fail_here("expected a static layer, got another kind of file");
  reader.skip(kLayerMagic.size());
  const LayerOrigin origin = take_origin(reader);
  std::vector<StaticHits> units;
  const std::int32_t count = reader.take_count("units", kMostUnits);
  for (std::int32_t i = 0; i < count; ++i) units.push_back(take_header(reader));
  for (StaticHits& unit : units) take_hits(reader, unit);
  if (reader.left() > 0)
    reader.fail_here("expected the end of the file, got " + std::to_string(reader.left()) +
                     " bytes more");
  return {name, hex_text(hash_name(bytes)), origin, std::move(units)};
}

StaticLayerFile read_static_layer(const std::filesystem::path& file) {
  return static_layer_from_bytes(read_file(file), file.string());
}

void check_is_at(const StaticLayerFile& file, const MountConfig& mount) {
  const std::array<double, 6> here = values_of(mount);
  for (std::size_t i = 0; i < kMountKeys.size(); ++i)
    if (file.origin.mount[i] != here[i])
      throw ConfigError(file.name + ": mounts." + kMountKeys[i] + ": expected " +
                        config::number_text(file.origin.mount[i]) +
                        ", as at the mount where the layer was made, got " +
                        config::number_text(here[i]));
}

void check_is_from(const StaticLayerFile& file, const LayerOrigin& here) {
  if (file.origin.scene != 0 && file.origin.scene != here.scene)
    throw ConfigError(
        file.name +
        ": (roads, ground, buildings, barriers, gantries, trunks, meshes): expected "
        "the static surfaces of the scene and preset from which the layer was made, got "
        "different surfaces");
}

void check_is_of(const StaticLayerFile& file, std::span<const StaticHits> units,
                 const std::string& lidar) {
  const auto check = [&](bool same, const std::string& what, const std::string& expected,
                         const std::string& got) {
    if (same) return;
    throw ConfigError(file.name + ": " + what + ": expected " + expected + ", as " + lidar +
                      " has, got " + got);
  };
  check(file.units.size() == units.size(), "units", std::to_string(units.size()),
        std::to_string(file.units.size()));
  for (std::size_t i = 0; i < units.size(); ++i) {
    const StaticHits &layer = file.units[i], &wanted = units[i];
    const std::string unit = "unit " + std::to_string(i);
    check(layer.groups == wanted.groups && layer.group_size == wanted.group_size, unit,
          size_text(wanted), size_text(layer));
    check(layer.max_range_m == wanted.max_range_m, unit + ": max_range_m",
          config::number_text(wanted.max_range_m), config::number_text(layer.max_range_m));
    check(
        layer.directions == wanted.directions, unit + ": directions",
        hex_text(wanted.directions) + " (channels, cut angle, phase, pitch and roll of the mount)",
        hex_text(layer.directions));
  }
}

}  // namespace infrasim
