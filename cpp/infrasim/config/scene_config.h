#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

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

/// A straight line, or an arc; a positive angle turns left.
struct CentrelinePiece {
  double line_m = 0;
  double radius_m = 0;
  double turn_deg = 0;
};

struct RoadStart {
  double x_m = 0;
  double y_m = 0;
  double heading_deg = 0;
};

/// Cross-section of a road. A two-way road has the same number of lanes on both sides of the
/// centreline, with traffic on the right. On a one-way road the centreline is in the middle of all
/// lanes.
struct LanesConfig {
  int each_way = 1;
  std::optional<bool> one_way;
  double width_m = 3.5;
  double median_m = 0;
  double shoulder_m = 0;
  double sidewalk_m = 0;
};

inline bool is_one_way(const LanesConfig& lanes) { return lanes.one_way.value_or(false); }

/// Distance from the centreline to the outer edge of the lanes.
inline double lanes_half_width(const LanesConfig& lanes) {
  const double one_side = lanes.each_way * lanes.width_m;
  return is_one_way(lanes) ? one_side / 2 : lanes.median_m / 2 + one_side;
}

struct EmbankmentConfig {
  double run_per_rise = 1.5;
  double foot_elevation_m = -8;
};

struct RoadConfig {
  std::string name;
  RoadStart start;
  std::vector<CentrelinePiece> centreline;
  double elevation_m = 0;
  LanesConfig lanes;
  std::optional<EmbankmentConfig> embankment;
  config::Place place;
};

/// The slope of the scene along one direction. All other keys describe a level scene. The profile
/// then raises each point by the rise at its position.
struct ProfileConfig {
  double x_m = 0;
  double y_m = 0;
  double heading_deg = 0;
  std::vector<Vec2> points_m;  ///< (station from x_m, y_m along heading_deg, rise at this station)
  double vertical_curve_m = 40;
};

/// A level piece of terrain with a convex outline. Where a scene has no terrain, rays towards the
/// ground have no return.
struct GroundConfig {
  double elevation_m = 0;
  std::vector<Vec2> outline_m;
  config::Place place;
};

/// The material of a mesh; the values are those of Class.
enum class Material { kRoad, kSidewalk, kTerrain, kStructure, kVegetation };

std::span<const char* const> enum_names(Material);

/// A surface from a file, in the world frame.
struct MeshConfig {
  std::string file;  ///< .ply, relative to the scene file
  Material material = Material::kStructure;
  config::Place place;
};

/// An upright box, such as a building or a pole.
struct BuildingConfig {
  double x_m = 0;
  double y_m = 0;
  double length_m = 10;
  double width_m = 10;
  double height_m = 10;
  double heading_deg = 0;
  double base_m = 0;
  config::Place place;
};

/// A wall along a road, from one station of its centreline to another.
struct BarrierConfig {
  std::string road;
  double offset_m = 0;  ///< positive to the left of the centreline
  double height_m = 0.8;
  double width_m = 0.3;
  double from_m = 0;
  double to_m = 1e9;
  config::Place place;
};

/// Probability per metre that leaves stop a ray. It is the leaf area density times the projection
/// G = 0.5 of randomly oriented leaves (Campbell, Norman: An Introduction to Environmental
/// Biophysics, 1998). Studies of street trees use leaf area densities of 1.5 m2/m3 (sparse) to 3
/// m2/m3 (dense). A clipped hedge is dense.
inline constexpr double kHedgeDensity_per_m = 1.5;
inline constexpr double kCrownDensity_per_m = 0.75;

/// A beam across a road on two legs outside the lanes.
struct GantryConfig {
  std::string road;
  double s_m = 0;
  double clearance_m = 6;
  config::Place place;
};

/// An upright box of leaves.
struct HedgeConfig {
  double x_m = 0;
  double y_m = 0;
  double length_m = 10;
  double width_m = 1;
  double height_m = 1.5;
  double heading_deg = 0;
  double base_m = 0;
  double density_per_m = kHedgeDensity_per_m;
  config::Place place;
};

/// A hedge along a road, defined like a barrier.
struct HedgeAlongConfig {
  std::string road;
  double offset_m = 0;  ///< positive to the left of the centreline
  double height_m = 1.5;
  double width_m = 1;
  double base_m = 0;  ///< height of the lower edge above the road
  double from_m = 0;
  double to_m = 1e9;
  double density_per_m = kHedgeDensity_per_m;
  config::Place place;
};

/// A tree: an ellipsoid of leaves on a solid trunk, which ends in the middle of the crown.
struct TreeShape {
  double height_m = 9;
  double crown_m = 5;  ///< diameter of the crown
  double trunk_m = 3;  ///< height of the trunk below the crown
  double trunk_width_m = 0.3;
  double base_m = 0;
  double density_per_m = kCrownDensity_per_m;
};

struct TreeConfig {
  double x_m = 0;
  double y_m = 0;
  TreeShape shape;
  config::Place place;
};

/// A row of trees along a road.
struct TreesAlongConfig {
  std::string road;
  double offset_m = 0;  ///< positive to the left of the centreline
  double every_m = 10;
  double from_m = 0;
  double to_m = 1e9;
  TreeShape shape;
  config::Place place;
};

struct VegetationConfig {
  std::optional<HedgeConfig> hedge;
  std::optional<HedgeAlongConfig> hedge_along;
  std::optional<TreeConfig> tree;
  std::optional<TreesAlongConfig> trees_along;
};

struct SignalConfig {
  double green_s = 14;
  double all_red_s = 2;
};

/// A ring of one lane around an island.
struct RoundaboutConfig {
  double radius_m = 15;
  double width_m = 6;
  double island_m = 0.3;
};

/// A crossing of two roads. It has signals with a green phase for each approach, or it is a
/// roundabout without signals.
struct JunctionConfig {
  std::vector<std::string> roads;
  /// without a value, signals have the default timing; not allowed together with `roundabout`
  std::optional<SignalConfig> signal;
  std::optional<RoundaboutConfig> roundabout;
  double left_share = 0.2;
  double right_share = 0.2;
  config::Place place;
};

struct SpeedConfig {
  double mean_km_h = 50;
  double std_km_h = 3;
};

inline constexpr double kStandstillGap_m = 2;  ///< gap between two vehicles that stand in a queue

struct TrafficConfig {
  double vehicles_per_km_lane = 12;
  SpeedConfig speed;
  double warm_up_s = 100;
  std::map<std::string, double> class_shares;
  config::Place place;
};

/// A row of parked vehicles along a road.
struct ParkedConfig {
  std::string road;
  double offset_m = 0;  ///< offset of the vehicles' centres, positive to the left of the centreline
  double from_m = 0;
  double to_m = 1e9;
  double turn_deg = 0;    ///< relative to the road's direction
  double gap_m = 1;       ///< mean gap between two vehicles
  double occupied = 0.8;  ///< share of the spaces with a vehicle
  double base_m = 0;      ///< height of the vehicles' base above the road
  std::map<std::string, double> class_shares;
  config::Place place;
};

enum class PersonKind { kPedestrian, kCyclist };

std::span<const char* const> enum_names(PersonKind);

struct PersonSpeedConfig {
  double mean_km_h = 5;
  double std_km_h = 0.5;
};

/// Pedestrians or cyclists that move along a line beside a road, in both directions.
struct PeopleConfig {
  std::string road;
  double offset_m = 0;  ///< offset of the line, positive to the left of the centreline
  double from_m = 0;
  double to_m = 1e9;
  double per_km = 0;  ///< number per kilometre of the line, both directions together
  PersonKind kind = PersonKind::kPedestrian;  ///< key `class`
  PersonSpeedConfig speed;
  config::Place place;
};

/// Pedestrians who stand close together, as at a crossing or a stop.
struct StandingPeopleConfig {
  double x_m = 0;  ///< centre of the group
  double y_m = 0;
  int count = 4;
  double spacing_m = 1.3;  ///< mean distance of neighbours
  double base_m = 0;       ///< world z of their feet
  config::Place place;
};

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
