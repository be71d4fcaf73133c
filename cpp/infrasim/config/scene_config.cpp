#include "infrasim/config/scene_config.h"

#include <ranges>
#include <set>

#include "infrasim/config/scene_keys.h"

namespace infrasim {

using config::at_least_one;
using config::between;
using config::positive;
using config::required;

std::span<const char* const> enum_names(Detail) {
  static constexpr std::array kNames{"box", "low", "mid", "fine"};
  return kNames;
}

std::span<const char* const> enum_names(LabelRule) {
  static constexpr std::array kNames{"hit", "all"};
  return kNames;
}

std::span<const char* const> enum_names(LabelTime) {
  static constexpr std::array kNames{"frame", "scan"};
  return kNames;
}

std::span<const char* const> enum_names(Material) {
  static constexpr std::array kNames{"road", "sidewalk", "terrain", "structure", "vegetation"};
  return kNames;
}

std::span<const char* const> enum_names(PersonKind) {
  static constexpr std::array kNames{"Pedestrian", "Cyclist"};
  return kNames;
}

LabelTime label_time_of(const SceneConfig& scene, const std::string& preset) {
  const bool study = preset == "paper" || preset == "equal";
  return scene.label_time.value_or(study ? LabelTime::kFrame : LabelTime::kScan);
}

template <class Fields>
void visit(Fields& f, CalibrationError& c) {
  f.field("x_m", c.x_m, "error of x_m", between(-10, 10));
  f.field("y_m", c.y_m, "error of y_m", between(-10, 10));
  f.field("z_m", c.z_m, "error of z_m", between(-10, 10));
  f.field("yaw_deg", c.yaw_deg, "error of yaw_deg", between(-180, 180));
  f.field("pitch_deg", c.pitch_deg, "error of pitch_deg", between(-90, 90));
  f.field("roll_deg", c.roll_deg, "error of roll_deg", between(-180, 180));
}

template <class Fields>
void visit(Fields& f, MountConfig& c) {
  f.here(c.place);
  f.field("x_m", c.x_m, "world x", required());
  f.field("y_m", c.y_m, "world y", required());
  f.field("z_m", c.z_m, "world z", required(between(-1e3, 1e4)));
  f.field("yaw_deg", c.yaw_deg, "viewing direction, from +x towards +y", between(-360, 360));
  f.field("pitch_deg", c.pitch_deg, "pitch; positive values point the LiDAR down",
          between(-90, 90));
  f.field("roll_deg", c.roll_deg, "roll; positive values lean the LiDAR to the right",
          between(-180, 180));
  f.field("clock_offset_s", c.clock_offset_s,
          "true time minus the time of the LiDAR's clock; default: 0", between(-0.1, 0.1));
  f.field("calibration_error", c.calibration_error,
          "pose that `run --fuse` assumes minus the true pose");
  f.field("own_random_stream", c.own_random_stream,
          "whether the mount has its own random stream for phases, noise and detection; default: "
          "true if there are several mounts");
}

template <class Fields>
void visit(Fields& f, WeatherConfig& c) {
  f.field("rain_mm_per_h", c.rain_mm_per_h, "rain rate", between(0, 300));
  f.field("visibility_m", c.visibility_m, "meteorological optical range; .inf: clear air",
          positive(kInf));
  f.field("sunlight_klux", c.sunlight_klux, "illuminance of the surfaces; 100: full sun, 0: night",
          between(0, 200));
}

template <class Fields>
void visit(Fields& f, VehicleParts& c) {
  f.field("glass", c.glass, "windows, and the surfaces behind them");
  f.field("tyres", c.tyres, "dark tyres");
  f.field("gap", c.gap, "gap between the wheels, below 0.2 m");
  f.field("coat", c.coat, "clear coat, which returns less light at grazing angles");
  f.field("reflectors", c.reflectors, "number plates and lamps");
}

bool is_folder_name(const std::string& name) {
  const bool plain = std::ranges::all_of(name, [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '-';
  });
  return plain && config::begins_as_name(name);
}

/// Checks that mount names can be folder names if a scene has several mounts. Each mount then has a
/// folder beside the folder of the fused frames.
template <class Fields>
void check_mounts(Fields& f, const SceneConfig& c) {
  for (const auto& [name, mount] : c.mounts) {
    const bool several = c.mounts.size() > 1;
    f.check(!several || (is_folder_name(name) && name != kFusedName), "mounts",
            std::string("expected a name of letters, digits, _ and - other than ") + kFusedName +
                ", because the scene has several mounts, got '" + name + "'");
    f.check(several || !mount.calibration_error, "mounts",
            "expected no calibration_error with a single mount, got one");
  }
}

template <class Fields>
void visit(Fields& f, RegionConfig& c) {
  f.here(c.place);
  f.field("name", c.name, "name of the region", required());
  check_name(f, c.name);
  f.field("outline_m", c.outline_m, "corners x y in order, in the world frame",
          required(between(-1e6, 1e6)));
  const bool area = c.outline_m.size() >= 3 && signed_area(c.outline_m) != 0;
  f.check(area, "outline_m",
          "expected an outline of 3 or more corners with an area, got fewer or no "
          "area");
}

template <class Fields>
void check_regions(Fields& f, const std::optional<std::vector<RegionConfig>>& regions) {
  std::set<std::string> names;
  if (!regions) return;
  for (const RegionConfig& region : *regions)
    f.check(names.insert(region.name).second, "regions",
            "expected a different name for each region, got '" + region.name + "' twice");
}

template <class Fields>
void visit(Fields& f, SceneConfig& c) {
  f.field("name", c.name, "name of the scene", required());
  f.check(config::begins_as_name(c.name), "name",
          "expected a name that begins with a letter, a digit or _, got '" + c.name + "'");
  f.field("seed", c.seed, "seed of the traffic, the phases of free motors and the returns");
  f.field("duration_s", c.duration_s, "duration of the run, in whole tenths of a second",
          between(0.1, kLongestScene_s));
  f.check(std::abs(10 * c.duration_s - std::round(10 * c.duration_s)) < 1e-6, "duration_s",
          "expected whole tenths of a second, got " + config::number_text(c.duration_s));
  f.field("aggregation", c.aggregation.word,
          "times at which rays are cast. exact: each ray at its firing time; instant: all rays of "
          "a frame at once; slices:N: N instants per frame");
  const auto aggregation = parse_aggregation(c.aggregation.word);
  f.check(aggregation.has_value(), "aggregation",
          std::string("expected ") + kAggregationWords + ", got '" + c.aggregation.word + "'");
  c.aggregation = aggregation.value_or(Aggregation{});
  f.field("detail", c.detail, "level of detail of the vehicle meshes");
  f.field("vehicle_parts", c.vehicle_parts,
          "vehicle parts with a reflectance of their own; used by LiDARs with returns.detection");
  f.field("labels", c.labels, "which objects get a label: those with points (hit), or all");
  f.field(
      "label_time", c.label_time,
      "time of the labels: the middle of the frame (frame), or the time at which the beams pass "
      "the vehicle (scan); default: frame under the presets paper and equal, otherwise scan");
  f.field("fields", c.point_fields,
          "whether time, ring, class and object of every point are written");
  f.field("region_half_length_m", c.region_half_length_m,
          "half length of the evaluation region along each road; with lanes, the radius of the "
          "region around the mount",
          between(1, 1e4));
  f.field("regions", c.regions, "outlines to which the evaluation region is restricted",
          config::Rule{.min_items = 1});
  check_regions(f, c.regions);
  f.field("mounts", c.mounts,
          "sensor poses by name; with several mounts, each mount gets a data set", at_least_one());
  check_mounts(f, c);
  f.field("weather", c.weather,
          "rain, fog and sunlight; they have an effect on LiDARs with returns.detection only");
  visit_ways(f, c);
  visit_static_objects(f, c);
  visit_junctions(f, c);
  f.field("filters", c.filters, "filters that every frame passes, in order");
  visit_traffic(f, c);
  f.field("static_layers", c.static_layers,
          "for each LiDAR, a file of `infrasim static` with the static points, which replaces "
          "casting the static scene");
  f.here(c.static_layers_key, "static_layers");
  f.check(!c.lanes || !c.traffic, "traffic",
          "expected trajectories with lanes of a file, got traffic, which needs "
          "roads");
  f.check(!c.static_layers || c.mounts.size() <= 1, "static_layers",
          "expected one mount, got several; a file of static points is valid at one mount only");
  f.check(c.traffic.has_value() == c.trajectories.empty(), "traffic",
          "expected either traffic or trajectories, got both or neither");
}

namespace {

SceneConfig scene_of(config::Tree tree, std::span<const std::string> assignments,
                     const std::string& preset) {
  const auto presets = config::take_presets(tree);
  if (presets) {
    for (std::size_t i = 0; i < presets->items.size(); ++i)
      config::expect_map(presets->items[i], "presets." + presets->keys[i]);
    if (const config::Tree* block = presets->find(preset)) tree = config::merged(tree, *block);
  }
  for (const std::string& assignment : assignments) config::override_value(tree, assignment);
  auto scene = config::read_struct<SceneConfig>(tree);
  scene.preset = preset;
  if (presets) scene.preset_blocks = presets->keys;
  return scene;
}

}  // namespace

SceneConfig read_scene(const std::filesystem::path& file, std::span<const std::string> assignments,
                       const std::string& preset) {
  SceneConfig scene = scene_of(config::read_tree(file), assignments, preset);
  scene.folder = file.parent_path();
  return scene;
}

SceneConfig parse_scene(const std::string& text, const std::string& name,
                        const std::string& preset) {
  return scene_of(config::parse_tree(text, name), {}, preset);
}

std::size_t road_index(const SceneConfig& scene, const std::string& name,
                       const config::Place& place, const char* key) {
  const auto names = scene.roads | std::views::transform(&RoadConfig::name);
  const auto found = std::ranges::find(names, name) - names.begin();
  if (found < std::ssize(names)) return static_cast<std::size_t>(found);
  const std::string allowed = names.empty() ? "no name, as the scene has no roads" : listed(names);
  config::fail(place, key, "expected " + allowed + ", got unknown road '" + name + "'");
}

SceneConfig scene_at_mount(const SceneConfig& scene, const std::string& mount) {
  const bool several = scene.mounts.size() > 1;
  const auto entry = mount.empty() && !several ? scene.mounts.begin() : scene.mounts.find(mount);
  if (entry == scene.mounts.end())
    throw ConfigError("mount: expected " + listed(std::views::keys(scene.mounts)) + ", got " +
                      (mount.empty() ? "none" : "'" + mount + "'"));
  SceneConfig view = scene;
  view.mounts = {*entry};
  MountConfig& pose = view.mounts[entry->first];
  if (several && !pose.own_random_stream) pose.own_random_stream = true;
  pose.calibration_error.reset();
  return view;
}

std::string dump_scene(const SceneConfig& scene) { return config::dump_struct(scene); }

std::string canonical_scene(const SceneConfig& scene) { return config::canonical_text(scene); }

std::string canonical_scene(const config::Tree& resolved) {
  return config::canonical_text(config::read_written<SceneConfig>(resolved));
}

std::string config::list_scene_keys() { return list_keys<SceneConfig>(); }

}  // namespace infrasim
