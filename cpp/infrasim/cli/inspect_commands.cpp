#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <sstream>

#include "infrasim/cli/catalogue.h"
#include "infrasim/cli/commands.h"
#include "infrasim/config/fields.h"
#include "infrasim/config/key_list.h"
#include "infrasim/config/lidar_checks.h"
#include "infrasim/config/lidar_config.h"
#include "infrasim/config/scene_config.h"
#include "infrasim/core/files.h"
#include "infrasim/core/math.h"
#include "infrasim/core/version.h"
#include "infrasim/pipeline/folder_identity.h"
#include "infrasim/pipeline/scanner_unit.h"
#include "infrasim/pipeline/world.h"
#include "infrasim/scene/mesh_file.h"
#include "infrasim/scene/sensor_rules.h"
#include "infrasim/scene/site_rules.h"
#include "infrasim/scene/traffic_checks.h"
#include "infrasim/sensor/pattern_table.h"
#include "infrasim/sensor/range_law.h"

namespace infrasim::cli {

namespace {

struct CheckOptions {
  std::string file;
  std::optional<std::string> preset;
  LidarChanges changes;
  std::vector<std::string> assignments;
  bool traffic = false;
  bool canonical = false;
  std::vector<std::string> lidars;
};

/// maximum relative error of the detection law at a published range
constexpr double kMostOff = 0.2;

/// Returns one line of text per distinct unit: the largest error of the unit's detection law at the
/// published ranges.
/// @throws ConfigError if the error of a range exceeds kMostOff
std::set<std::string> law_errors(const std::filesystem::path& file, const LidarConfig& lidar) {
  std::set<std::string> lines;
  for (const LidarUnit& unit : lidar.units) {
    const ReturnsConfig& returns = unit.returns;
    if (!returns.detection || returns.detection->further_ranges.empty()) continue;
    const LawRange worst = worst_of_law(*returns.detection, returns.max_range_m);
    const auto n = [](double v) { return config::number_text(std::round(v * 10) / 10); };
    const std::string law = n(worst.law_m) + " m by the fitted law for the published range of " +
                            range_text(worst.published);
    if (std::abs(worst.error()) > kMostOff)
      throw ConfigError(file.string() +
                        ": returns.detection.further_ranges: expected ranges that one detection " +
                        "law predicts within " + n(100 * kMostOff) + " %, got " + law);
    std::string line = lidar.name + ": detection law: off by at most ";
    line += n(100 * std::abs(worst.error())) + " %, " + law;
    lines.insert(line);
  }
  return lines;
}

/// Reads the LiDAR under a preset, or under all presets if none is given, and traces every ray.
/// Returns the LiDAR under the given preset, or under `datasheet`.
LidarConfig checked_lidar(const std::filesystem::path& file,
                          const std::optional<std::string>& preset, const LidarChanges& changes) {
  const auto checked = [&](const std::string& name, bool printed) {
    LidarConfig lidar = with_changes(read_lidar(file, name),
                                     printed ? changes : LidarChanges{changes.rate_hz, {}, {}});
    fields_of_view(lidar);
    for (const std::string& line : law_errors(file, lidar))
      if (printed) std::fprintf(stderr, "infrasim: %s\n", line.c_str());
    for (const std::string& line : lidar_warnings({&lidar, 1}))
      if (printed) std::fprintf(stderr, "infrasim: warning: %s\n", line.c_str());
    return lidar;
  };
  LidarConfig lidar = checked(preset.value_or("datasheet"), true);
  if (!preset)
    for (const std::string& name : preset_names(file)) checked(name, false);
  return lidar;
}

/// @throws ConfigError if vehicles overlap
void check_traffic(const std::filesystem::path& file, const SceneConfig& scene) {
  const std::vector<Overlap> overlaps = traffic_overlaps(scene);
  if (overlaps.empty()) return;
  throw ConfigError((scene.traffic ? file : scene.folder / scene.trajectories).string() + ": " +
                    overlap_text(overlaps));
}

/// Builds the scene under the given preset. If no preset is given, the scene is built without a
/// preset and under every preset of the file.
/// @param findings remarks that are not errors, without duplicates
SceneConfig checked_scene(const std::filesystem::path& file, const CheckOptions& o,
                          std::set<std::string>& findings) {
  std::vector<SceneConfig> driven;
  // A newly imported site has no traffic yet, but all other keys can be checked.
  const auto lacks_trajectories = [&](const SceneConfig& scene) {
    const std::filesystem::path recorded = scene.folder / scene.trajectories;
    if (scene.traffic || std::filesystem::exists(recorded)) return false;
    findings.insert(
        "no-trajectories: " + recorded.string() +
        ": file does not exist, so vehicles are not checked: `pyinfra site traffic` or `pyinfra "
        "site trajectories` writes it");
    return true;
  };
  const auto checked = [&](const std::string& preset) {
    SceneConfig scene = read_scene(file, o.assignments, preset);
    const bool known = std::ranges::any_of(
        driven, [&](const SceneConfig& other) { return move_alike(scene, other); });
    const bool drive = !known && (o.traffic || !lacks_trajectories(scene));
    for (const std::string& line : check_worlds(scene, drive)) findings.insert(line);
    for (const std::string& line : flat_triangles(scene)) findings.insert(line);
    if (o.traffic && drive) check_traffic(file, scene);
    if (drive) driven.push_back(scene);
    return scene;
  };
  SceneConfig scene = checked(o.preset.value_or("datasheet"));
  if (o.preset || scene.preset_blocks.empty()) return scene;
  checked("");
  for (const std::string& name : scene.preset_blocks)
    if (name != scene.preset) checked(name);
  return scene;
}

std::string compass(double bearing_deg) {
  constexpr std::array<const char*, 8> kNames{"north", "north-east", "east", "south-east",
                                              "south", "south-west", "west", "north-west"};
  const auto at = static_cast<std::size_t>(std::lround(bearing_deg / 45)) % kNames.size();
  return config::number_text(std::round(bearing_deg)) + " degrees (" + kNames.at(at) + ")";
}

/// Describes where a ray at the given elevation meets level ground `height_m` below the sensor, in
/// the direction in which the unit looks.
/// @param pose rotation from the unit's frame to the levelled frame
std::string meets_ground(const Mat3& pose, double elevation_deg, double height_m) {
  const double e = rad(elevation_deg);
  const Vec3 ray = pose * Vec3{math::cos(e), 0, math::sin(e)};
  if (ray.z > -1e-3) return "above the horizon";
  return "at " + config::number_text(std::round(height_m * math::hypot(ray.x, ray.y) / -ray.z)) +
         " m";
}

/// Returns one line per mount about the compass bearing of the mount, and one line per mount and
/// LiDAR about the visible ground. North is the y axis of the scene.
std::vector<std::string> views_of_mounts(const SceneConfig& scene, const CheckOptions& o) {
  std::vector<std::string> lines;
  const auto whole = [](double v) { return config::number_text(std::round(v * 10) / 10); };
  const Site site = build_site(scene);
  for (const auto& [name, mount] : scene.mounts) {
    const Vec2 foot{mount.x_m, mount.y_m};
    const double height = height_above_surface(site, foot, mount.z_m - site.profile.rise(foot));
    const auto bearing = [&, yaw = mount.yaw_deg](double azimuth_deg) {
      return std::fmod(std::fmod(90 - yaw - azimuth_deg, 360) + 360, 360);
    };
    lines.push_back("mount " + name + ": " + whole(height) + " m above the road, looks to " +
                    compass(bearing(0)) + ", y is north");
    for (const std::string& word : o.lidars) {
      const LidarConfig lidar = lidar_of(word, o.preset.value_or("datasheet"), o.changes);
      const std::vector<FieldOfView> views = fields_of_view(lidar);
      for (std::size_t i = 0; i < views.size(); ++i) {
        const FieldOfView& view = views[i];
        const double width = view.azimuth_max_deg - view.azimuth_min_deg;
        const double turn = lidar.units[i].yaw_deg;
        const std::string seen =
            width > 359 ? "sees all round"
                        : "sees from " + compass(bearing(view.azimuth_max_deg + turn)) + " to " +
                              compass(bearing(view.azimuth_min_deg + turn));
        const Mat3 pose = unit_pose(scene_at_mount(scene, name), lidar.units[i]);
        std::ostringstream line;
        line << "mount " << name << ", " << lidar.name << ": " << seen
             << "; the lowest ray meets the ground "
             << meets_ground(pose, view.elevation_min_deg, height) << ", the highest "
             << meets_ground(pose, view.elevation_max_deg, height);
        lines.push_back(line.str());
      }
    }
  }
  return lines;
}

/// Returns the text that identifies the frames of a scene or LiDAR. The file is a configuration
/// file, or the dataset.yaml or lidar.yaml of a folder.
std::string canonical_of(const std::filesystem::path& file, const config::Tree& tree, bool lidar,
                         const CheckOptions& o) {
  if (tree.find("T_world_levelled") != nullptr)
    return lidar_identity(read_file(file), file.string());
  if (tree.find("version") != nullptr) return data_set_identity(read_file(file), file.string());
  const std::string preset = o.preset.value_or("datasheet");
  if (lidar) return canonical_lidar(with_changes(read_lidar(file, preset), o.changes));
  return canonical_scene(read_scene(file, o.assignments, preset)) +
         "frames_version: " + std::to_string(kFramesVersion) + "\n";
}

void check_command(const CheckOptions& o) {
  const std::filesystem::path file = config_file(o.file, {"lidars", "scenes"});
  const config::Tree tree = config::read_tree(file);
  const bool lidar = tree.find("roads") == nullptr && tree.find("mounts") == nullptr &&
                     (tree.find("pattern") != nullptr || tree.find("bundle") != nullptr ||
                      tree.find("presets") != nullptr);
  if (o.canonical) {
    std::fputs(canonical_of(file, tree, lidar, o).c_str(), stdout);
    return;
  }
  if (lidar) {
    if (!o.assignments.empty())
      throw ConfigError("--set: use it with a scene, not with a LiDAR file");
    if (o.traffic) throw ConfigError("--traffic: use it with a scene, not with a LiDAR file");
    if (!o.lidars.empty()) throw ConfigError("--lidar: use it with a scene, not with a LiDAR file");
    std::fputs(dump_lidar(checked_lidar(file, o.preset, o.changes)).c_str(), stdout);
    return;
  }
  if (o.changes.law_exponent)
    throw ConfigError("--law-exponent: use it with a LiDAR file, not with a scene file");
  if (o.changes.echo) throw ConfigError("--echo: use it with a LiDAR file, not with a scene file");
  std::set<std::string> findings;
  const SceneConfig scene = checked_scene(file, o, findings);
  for (const std::string& line : findings)
    std::fprintf(stderr, "infrasim: warning: %s\n", line.c_str());
  const std::vector<std::string> views = views_of_mounts(scene, o);
  std::fputs(dump_scene(scene).c_str(), stdout);
  if (std::fflush(stdout) != 0) return;  // the function main reports the error
  for (const std::string& line : views) std::fprintf(stderr, "infrasim: %s\n", line.c_str());
}

}  // namespace

void add_check_command(CLI::App& app) {
  auto* command = app.add_subcommand(
      "check",
      "Check a scene or LiDAR file and print it with every default.\nExample: infrasim "
      "check configs/scenes/highway.yaml");
  auto o = std::make_shared<CheckOptions>();
  command->add_option("file", o->file, "scene or LiDAR: a file or a name")->required();
  command->add_option(
      "--preset", o->preset,
      "preset of the file; default: all presets are checked, and datasheet is printed");
  command->add_option("--set", o->assignments, "KEY=VALUE: overrides a key of a scene");
  command->add_option("--law-exponent", o->changes.law_exponent, kLawExponentHelp);
  command->add_option("--echo", o->changes.echo, kEchoHelp);
  command->add_option("--lidar", o->lidars,
                      "LiDARs: files or names; print what they see of the ground from the mounts");
  command->add_option("--rate-hz", o->changes.rate_hz, kRateHelp);
  command->add_flag("--canonical", o->canonical,
                    "print the keys under the names of version 0.3, and the version of the frames, "
                    "which identify results; check nothing else");
  command->add_flag(
      "--traffic", o->traffic,
      "also check for overlapping vehicles, in one minute of traffic or in all trajectories");
  command->callback([o] { check_command(*o); });
}

void add_keys_command(CLI::App& app) {
  auto* command = app.add_subcommand(
      "keys",
      "List every key with path, type, default, allowed values and meaning, separated by tabs.\n"
      "Example: infrasim keys scene");
  auto kind = std::make_shared<std::string>();
  command->add_option("kind", *kind, "kind of file: scene or lidar")
      ->required()
      ->check(CLI::IsMember({"scene", "lidar"}));
  command->callback([kind] {
    const bool scene = *kind == "scene";
    const auto text = scene ? config::list_scene_keys() : config::list_lidar_keys();
    std::fputs(text.c_str(), stdout);
  });
}

}  // namespace infrasim::cli
