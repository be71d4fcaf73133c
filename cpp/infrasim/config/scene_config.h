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

// Structs with the keys of a scene file. The name of a key contains its unit. Positions are in the
// world frame, in which z points up.

namespace infrasim {

enum class Detail { kBox, kLow, kMid, kFine };
enum class LabelRule { kHit, kAll };

std::span<const char* const> enum_names(Detail);
std::span<const char* const> enum_names(LabelRule);
std::span<const char* const> enum_names(LabelTime);

/// Error of a mount's pose when point clouds are fused: the assumed pose minus the true pose.
struct CalibrationError {
  double x_m = 0;
  double y_m = 0;
  double z_m = 0;
  double yaw_deg = 0;
  double pitch_deg = 0;
  double roll_deg = 0;
};

/// The pose of a mount, at which each LiDAR of a run is simulated.
struct MountConfig {
  double x_m = 0;
  double y_m = 0;
  double z_m = 6;
  double yaw_deg = 0;
  double pitch_deg = 0;  ///< positive if the LiDAR points down
  double roll_deg = 0;
  /// true time minus the time of the LiDAR's clock
  std::optional<double> clock_offset_s = std::nullopt;
  std::optional<CalibrationError> calibration_error = std::nullopt;
  /// whether the mount has its own random stream; default: true if the scene has several mounts
  std::optional<bool> own_random_stream = std::nullopt;
  config::Place place = {};
};

struct WeatherConfig {
  double rain_mm_per_h = 0;
  double visibility_m = kInf;
  double sunlight_klux = 100;
};

/// Parts of vehicles whose optical properties differ from those of paint. They affect LiDARs that
/// detect by received power. A part is off by default if it changes the number of points on cars by
/// less than 1 % (`python -m reproduction fidelity`).
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
  config::Place place = {};
};

/// name of the folder of fused frames; if a scene has several mounts, no mount may have this name
inline constexpr const char* kFusedName = "fused";
inline constexpr double kLongestScene_s = 36000;
inline constexpr double kSteepest = 0.15;  ///< maximum grade of a road; steeper streets are rare
/// minimum free height above a road, in metres; trucks are up to 4.4 m high
inline constexpr double kClearance_m = 4.5;

/// A part of the evaluation region. Its outline is in the world frame.
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
  std::optional<LabelTime> label_time;  ///< label time; default: the result of label_time_of
  /// value of the key `fields`: whether each point's time, ring, class and object are written
  bool point_fields = false;
  double region_half_length_m = 100;
  NamedMap<MountConfig> mounts;
  WeatherConfig weather;
  /// outlines of the evaluation region; if missing, the region covers all roads or lanes
  std::optional<std::vector<RegionConfig>> regions;
  /// path of a file of lanes that replaces `roads`, relative to the scene file
  std::optional<std::string> lanes;
  std::vector<RoadConfig> roads;
  std::optional<ProfileConfig> profile;  ///< elevation profile; if missing, the scene is level
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
  /// path of a file of trajectories that replaces `traffic`, relative to the scene file
  std::string trajectories;
  /// For each LiDAR, the path of a file with the hits of rays on static surfaces, relative to the
  /// scene file. The hits in the file are not computed again.
  std::optional<std::map<std::string, std::string>> static_layers;
  config::KeyPlace lanes_key, trajectories_key, static_layers_key;
  std::filesystem::path folder;  ///< folder of the scene file; not a key of this file
  std::string preset;  ///< LiDAR preset for which the file was read; not a key of this file
  /// names of the LiDAR presets for which the scene file has a block of keys; not a key of this
  /// file
  std::vector<std::string> preset_blocks;
};

/// Returns the scene with only one of its mounts, as in a data set of that mount.
/// @param mount name of the mount; may be empty if the scene has one mount
/// @throws ConfigError if the mount is unknown, or if the name is empty and the scene has several
/// mounts
SceneConfig scene_at_mount(const SceneConfig& scene, const std::string& mount);

/// Returns the label time of a scene: the instant for which the boxes of labels hold. The default
/// is `frame` under the presets `paper` and `equal`, as in the study's simulator. Under any other
/// preset the default is `scan`, because annotators draw boxes around points.
LabelTime label_time_of(const SceneConfig& scene, const std::string& preset);

/// Reads a scene file. The block of the preset, if there is one, overrides other keys, and `--set
/// KEY=VALUE` assignments override both.
/// @param preset preset of the run's LiDARs
/// @throws ConfigError, IoError
SceneConfig read_scene(const std::filesystem::path& file,
                       std::span<const std::string> assignments = {},
                       const std::string& preset = "");

/// Returns the index of a road in `scene.roads`. `place` and `key` are those of the entry that
/// names the road.
/// @throws ConfigError if the name is unknown
std::size_t road_index(const SceneConfig& scene, const std::string& name,
                       const config::Place& place, const char* key);

/// Like read_scene, but reads from a text. Messages use `name` as the file name.
SceneConfig parse_scene(const std::string& text, const std::string& name,
                        const std::string& preset = "");

/// Returns every key with its value, as YAML. Reading this text gives the same scene.
std::string dump_scene(const SceneConfig& scene);

/// Like dump_scene, but with the canonical names of keys (those of version 0.3). The text
/// identifies the frames that are simulated from the scene.
std::string canonical_scene(const SceneConfig& scene);
/// @param resolved keys written by `dump_scene` of this version or an older one
std::string canonical_scene(const config::Tree& resolved);

}  // namespace infrasim
