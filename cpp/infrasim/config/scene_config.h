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

// The scene file, key by key. Units are in the names; world frame, z up.

namespace infrasim {

enum class Detail { kBox, kLow, kMid, kFine };
enum class LabelRule { kHit, kAll };

std::span<const char* const> enum_names(Detail);
std::span<const char* const> enum_names(LabelRule);
std::span<const char* const> enum_names(LabelTime);

/// A line, or an arc that turns left for a positive angle.
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

/// Cross-section: the same number of lanes on both sides of the centreline, traffic on the right;
/// of a one-way road all lanes side by side, the centreline in their middle.
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

/// How the scene rises along one direction: what it says is level, and lifted by this where it is.
struct ProfileConfig {
  double x_m = 0;
  double y_m = 0;
  double heading_deg = 0;
  std::vector<Vec2> points_m;  ///< station from x_m, y_m along heading_deg, and rise there
  double vertical_curve_m = 40;
};

/// A level piece of terrain with a convex outline; where no ground is, rays pass.
struct GroundConfig {
  double elevation_m = 0;
  std::vector<Vec2> outline_m;
  config::Place place;
};

/// What a mesh is made of; the values are those of Class.
enum class Material { kRoad, kSidewalk, kTerrain, kStructure, kVegetation };

std::span<const char* const> enum_names(Material);

/// A surface from a file; world frame.
struct MeshConfig {
  std::string file;  ///< .ply, relative to the scene file
  Material material = Material::kStructure;
  config::Place place;
};

/// An upright box: building, pole, or anything that stands.
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
  double offset_m = 0;  ///< to the left of the centreline
  double height_m = 0.8;
  double width_m = 0.3;
  double from_m = 0;
  double to_m = 1e9;
  config::Place place;
};

/// Chance per metre that leaves stop a ray: G = 0.5 of randomly turned leaves (Campbell, Norman:
/// An Introduction to Environmental Biophysics, 1998) times the area of leaves in a volume, for
/// which studies of street trees take 1.5 m2/m3 (sparse) to 3 (dense); a clipped hedge is dense.
inline constexpr double kHedgeDensity_per_m = 1.5;
inline constexpr double kCrownDensity_per_m = 0.75;

/// A beam across a road on two legs outside its lanes.
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

/// A hedge along a road, as a barrier is.
struct HedgeAlongConfig {
  std::string road;
  double offset_m = 0;  ///< to the left of the centreline
  double height_m = 1.5;
  double width_m = 1;
  double base_m = 0;  ///< above the road
  double from_m = 0;
  double to_m = 1e9;
  double density_per_m = kHedgeDensity_per_m;
  config::Place place;
};

/// A crown, which is an ellipsoid of leaves, on a trunk, which is solid up to the crown's middle.
struct TreeShape {
  double height_m = 9;
  double crown_m = 5;  ///< across
  double trunk_m = 3;  ///< up to the crown
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
  double offset_m = 0;  ///< to the left of the centreline
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

/// Signals where two roads cross, each approach with its own green; or a roundabout, without any.
struct JunctionConfig {
  std::vector<std::string> roads;
  std::optional<SignalConfig> signal;  ///< its defaults, if there is no roundabout
  std::optional<RoundaboutConfig> roundabout;
  double left_share = 0.2;
  double right_share = 0.2;
  config::Place place;
};

struct SpeedConfig {
  double mean_km_h = 50;
  double std_km_h = 3;
};

inline constexpr double kStandstillGap_m = 2;  ///< between vehicles that queue

struct TrafficConfig {
  double vehicles_per_km_lane = 12;
  SpeedConfig speed;
  double warm_up_s = 100;
  std::map<std::string, double> class_shares;
  config::Place place;
};

/// Vehicles that stand in a row along a road.
struct ParkedConfig {
  std::string road;
  double offset_m = 0;  ///< of their middles, to the left of the centreline
  double from_m = 0;
  double to_m = 1e9;
  double turn_deg = 0;    ///< from the road's direction
  double gap_m = 1;       ///< between two of them, mean
  double occupied = 0.8;  ///< share of the places that a vehicle stands in
  double base_m = 0;      ///< above the road
  std::map<std::string, double> class_shares;
  config::Place place;
};

enum class PersonKind { kPedestrian, kCyclist };

std::span<const char* const> enum_names(PersonKind);

struct PersonSpeedConfig {
  double mean_km_h = 5;
  double std_km_h = 0.5;
};

/// People on foot or on bicycles that go along a line beside a road, both ways.
struct PeopleConfig {
  std::string road;
  double offset_m = 0;  ///< of the line, to the left of the centreline
  double from_m = 0;
  double to_m = 1e9;
  double per_km = 0;                          ///< of the line, both ways together
  PersonKind kind = PersonKind::kPedestrian;  ///< key `class`
  PersonSpeedConfig speed;
  config::Place place;
};

/// Pedestrians who stand close together, as at a crossing or a stop.
struct StandingPeopleConfig {
  double x_m = 0;  ///< of the middle
  double y_m = 0;
  int count = 4;
  double spacing_m = 1.3;  ///< between neighbours, mean
  double base_m = 0;       ///< world z that they stand on
  config::Place place;
};

/// What a fusion takes a mount's pose to be, less what it is.
struct CalibrationError {
  double x_m = 0;
  double y_m = 0;
  double z_m = 0;
  double yaw_deg = 0;
  double pitch_deg = 0;
  double roll_deg = 0;
};

/// A pose of the LiDARs of a run.
struct MountConfig {
  double x_m = 0;
  double y_m = 0;
  double z_m = 6;
  double yaw_deg = 0;
  double pitch_deg = 0;  ///< positive looks down
  double roll_deg = 0;
  std::optional<double> clock_offset_s = std::nullopt;  ///< true time less what its stamps say
  std::optional<CalibrationError> calibration_error = std::nullopt;
  std::optional<bool> own_draws = std::nullopt;  ///< nothing: if the scene has several mounts
  config::Place place = {};
};

struct WeatherConfig {
  double rain_mm_per_h = 0;
  double visibility_m = kInf;
  double sunlight_klux = 100;
};

/// What LiDARs that detect by received power see of vehicles apart from plain paint. What takes
/// less than a hundredth of a car's points or gives it no more is off (reproduction, fidelity).
struct VehicleParts {
  bool glass = true;
  bool tyres = false;
  bool gap = true;
  bool coat = true;
  bool reflectors = false;

  bool any() const { return glass || tyres || gap || coat || reflectors; }
};

/// One step that thins out the points of every frame.
struct FilterConfig {
  FilterOf<BackgroundFilter> step;
};

inline constexpr const char* kFusedName = "fused";  ///< folder that no mount has
inline constexpr double kLongestScene_s = 36000;
inline constexpr double kSteepest = 0.15;    ///< grade; steeper streets are rare
inline constexpr double kClearance_m = 4.5;  ///< of free height over a road: trucks have up to 4.4

/// A piece of the evaluation region; world frame.
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
  std::optional<LabelTime> label_time;  ///< nothing: as label_time_of has it
  bool point_fields = false;            ///< key `fields`
  double region_half_length_m = 100;
  NamedMap<MountConfig> mounts;
  WeatherConfig weather;
  std::optional<std::vector<RegionConfig>> regions;  ///< nothing: wherever roads or lanes are
  std::optional<std::string> lanes;  ///< a file in place of roads; relative to the scene file
  std::vector<RoadConfig> roads;
  std::optional<ProfileConfig> profile;  ///< nothing: level
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
  std::string trajectories;  ///< a file instead of traffic; relative to the scene file
  /// By LiDAR, a file in place of casting what stands still; relative to the scene file.
  std::optional<std::map<std::string, std::string>> static_layers;
  std::filesystem::path folder;            ///< of the scene file; no key
  std::string preset;                      ///< that the file was read for; no key
  std::vector<std::string> preset_blocks;  ///< names of those that the file has; no key
};

/// The scene as a data set of one mount has it: without the others.
/// @param mount its name; empty: the only one
/// @throws ConfigError if there is none of the name, or none is named of several
SceneConfig scene_at_mount(const SceneConfig& scene, const std::string& mount);

/// What a scene says, else `frame` under the presets `paper` and `equal`, as the study's simulator
/// labels, and `scan` under any other, as annotators do who draw around the points.
LabelTime label_time_of(const SceneConfig& scene, const std::string& preset);

/// Reads a scene file, with the block of a preset, if it has one, on top of its other keys, and
/// `--set KEY=VALUE` assignments on top of both.
/// @param preset of the run's LiDARs
/// @throws ConfigError, IoError
SceneConfig read_scene(const std::filesystem::path& file,
                       std::span<const std::string> assignments = {},
                       const std::string& preset = "");

/// Where a road stands in `scene.roads`; `place` and `key` are those of whoever names it.
/// @throws ConfigError if there is none of the name
std::size_t road_index(const SceneConfig& scene, const std::string& name,
                       const config::Place& place, const char* key);

/// The same from text; `name` stands for the file in messages.
SceneConfig parse_scene(const std::string& text, const std::string& name,
                        const std::string& preset = "");

/// Every key with its value, as YAML that reads back to the same scene.
std::string dump_scene(const SceneConfig& scene);

/// The same by the canonical names of keys: what its frames are told by.
std::string canonical_scene(const SceneConfig& scene);
/// @param resolved the keys that `dump_scene` wrote, of this version or an older one
std::string canonical_scene(const config::Tree& resolved);

}  // namespace infrasim
