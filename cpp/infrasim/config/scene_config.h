#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "infrasim/config/roads_config.h"
#include "infrasim/config/static_objects_config.h"
#include "infrasim/config/traffic_config.h"
#include "infrasim/config/tree.h"
#include "infrasim/core/aggregation.h"
#include "infrasim/core/filter_steps.h"
#include "infrasim/core/frame.h"
#include "infrasim/core/geometry.h"
#include "infrasim/core/named_map.h"

// The scene file, key by key. Names contain units. Positions are in the world frame, z up.

namespace infrasim {

enum class Detail { kBox, kLow, kMid, kFine };
enum class LabelRule { kHit, kAll };

std::span<const char* const> enum_names(Detail);
std::span<const char* const> enum_names(LabelRule);
std::span<const char* const> enum_names(LabelTime);

/// Error of a mount's pose in the fusion: the assumed pose minus the true pose.
struct CalibrationError {
  double x_m = 0;
  double y_m = 0;
  double z_m = 0;
  double yaw_deg = 0;
  double pitch_deg = 0;
  double roll_deg = 0;
};

/// The pose of the LiDARs of a run.
struct MountConfig {
  double x_m = 0;
  double y_m = 0;
  double z_m = 6;
  double yaw_deg = 0;
  double pitch_deg = 0;  ///< a positive pitch looks down
  double roll_deg = 0;
  std::optional<double> clock_offset_s = std::nullopt;  ///< true time minus time stamp
  std::optional<CalibrationError> calibration_error = std::nullopt;
  std::optional<bool> own_random_stream =
      std::nullopt;  ///< default: true if the scene has several mounts
  config::Place place = {};
};

struct WeatherConfig {
  double rain_mm_per_h = 0;
  double visibility_m = kInf;
  double sunlight_klux = 100;
};

/// Parts of vehicles whose optical properties differ from those of paint. They affect LiDARs that
/// detect by received power. A part is off by default if it changes the points on a car by less
/// than 1 % (`python -m reproduction fidelity`).
struct VehicleParts {
  bool glass = true;
  bool tyres = false;
  bool gap = true;
  bool coat = true;
  bool reflectors = false;

  bool any() const { return glass || tyres || gap || coat || reflectors; }
};

/// One step that removes points from every frame.
struct FilterConfig {
  FilterOf<BackgroundFilter> step;
};

/// name of the folder of fused frames; if a scene has several mounts, none may have this name
inline constexpr const char* kFusedName = "fused";
inline constexpr double kLongestScene_s = 36000;
inline constexpr double kSteepest = 0.15;  ///< maximum grade; steeper streets are rare
/// free height over a road; trucks are up to 4.4 m high
inline constexpr double kClearance_m = 4.5;

/// A part of the evaluation region, in the world frame.
struct RegionConfig {
  std::string name;
  std::vector<Vec2> outline_m;
  config::Place place;
};

struct SceneConfig {
  std::string name;
  std::uint64_t seed = 1;
  double duration_s = 500;
  Aggregation aggregation;
  Detail detail = Detail::kLow;
  VehicleParts vehicle_parts;
  LabelRule labels = LabelRule::kHit;
  std::optional<LabelTime> label_time;  ///< default: see label_time_of
  bool point_fields = false;            ///< key `fields`
  double region_half_length_m = 100;
  NamedMap<MountConfig> mounts;
  WeatherConfig weather;
  std::optional<std::vector<RegionConfig>> regions;  ///< default: all roads or lanes
  std::optional<std::string> lanes;  ///< a file that replaces `roads`, relative to the scene file
  std::vector<RoadConfig> roads;
  std::optional<ProfileConfig> profile;  ///< default: a level scene
  std::optional<std::vector<MeshConfig>> meshes;
  std::vector<GroundConfig> ground;
  std::vector<BuildingConfig> buildings;
  std::vector<BarrierConfig> barriers;
  std::vector<GantryConfig> gantries;
  std::vector<VegetationConfig> vegetation;
  std::vector<JunctionConfig> junctions;
  std::vector<FilterConfig> filters;
  std::optional<TrafficConfig> traffic;
  std::optional<std::vector<ParkedConfig>> parked;
  std::optional<std::vector<PeopleConfig>> people;
  std::optional<std::vector<StandingPeopleConfig>> standing_people;
  std::string trajectories;  ///< a file that replaces `traffic`, relative to the scene file
  /// For each LiDAR, a file with the hits of rays on static surfaces. The hits in the file are not
  /// computed again. The path is relative to the scene file.
  std::optional<std::map<std::string, std::string>> static_layers;
  std::filesystem::path folder;  ///< folder of the scene file; not a key
  std::string preset;            ///< the preset that the file was read for; not a key
  /// names of the presets with a block in the file; not a key
  std::vector<std::string> preset_blocks;
};

/// The scene with only one of its mounts, as in a data set of that mount.
/// @param mount name of the mount; may be empty if the scene has one mount
/// @throws ConfigError if the mount is unknown, or if the name is empty and the scene has several
/// mounts
SceneConfig scene_at_mount(const SceneConfig& scene, const std::string& mount);

/// Returns the label time of a scene. The default is `frame` under the presets `paper` and `equal`,
/// as in the study's simulator. Under any other preset the default is `scan`, because annotators
/// draw boxes around points.
LabelTime label_time_of(const SceneConfig& scene, const std::string& preset);

/// Reads a scene file. The block of the preset, if there is one, overrides other keys, and `--set
/// KEY=VALUE` assignments override both.
/// @param preset preset of the run's LiDARs
/// @throws ConfigError, IoError
SceneConfig read_scene(const std::filesystem::path& file,
                       std::span<const std::string> assignments = {},
                       const std::string& preset = "");

/// Index of a road in `scene.roads`. `place` and `key` are those of the entry that names the road.
/// @throws ConfigError if the name is unknown
std::size_t road_index(const SceneConfig& scene, const std::string& name,
                       const config::Place& place, const char* key);

/// Like read_scene, but reads from a text. Messages use `name` as the file name.
SceneConfig parse_scene(const std::string& text, const std::string& name,
                        const std::string& preset = "");

/// Returns every key with its value, as YAML. Reading this text gives the same scene.
std::string dump_scene(const SceneConfig& scene);

/// Like dump_scene, but with canonical names of keys. The text is the identity of the scene's
/// frames.
std::string canonical_scene(const SceneConfig& scene);
/// @param resolved keys written by `dump_scene` of this version or an older one
std::string canonical_scene(const config::Tree& resolved);

}  // namespace infrasim
