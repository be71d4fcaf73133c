#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "infrasim/core/fraction.h"
#include "infrasim/core/geometry.h"

// The LiDAR file, key by key, for one of its presets.

namespace infrasim {

namespace config {
struct Tree;
}

/// One laser of a spinning sensor.
struct Channel {
  double elevation_deg = 0;
  double azimuth_offset_deg = 0;  ///< in the direction of rotation
  double fire_time_us = 0;        ///< after the start of its column
};

/// Channels from a file, or evenly spaced from upper to lower.
struct ChannelsConfig {
  std::string file;
  int count = 0;
  double upper_deg = 0;
  double lower_deg = 0;
  std::vector<Channel> table;  ///< resolved
};

/// How a pattern starts. Free motors start at a draw of the seed, the mount and the unit.
enum class MotorPhase { kLocked, kFree };
std::span<const char* const> enum_names(MotorPhase);

/// Turns clockwise seen from above, as all sensors of the catalogue do. Has one of
/// azimuth_step_deg and columns_per_turn.
struct SpinningConfig {
  double rate_hz = 10;
  MotorPhase phase = MotorPhase::kLocked;  ///< locked: at time 0 it stands at cut_angle_deg
  double cut_angle_deg = 180;              ///< azimuth in the unit's own frame
  std::optional<double> azimuth_step_deg;
  std::optional<Fraction>
      columns_per_turn;  ///< exact; its columns repeat after `denominator` turns
  ChannelsConfig channels;
};
double columns_per_s(const SpinningConfig& spinning);
/// Also where a step says it, such as 0.2: that is the number nearest to 360 / 1800. Nothing for
/// steps that no fraction with a denominator up to 16 gives.
std::optional<Fraction> columns_per_turn(const SpinningConfig& spinning);

enum class Faces { kTiltedFirst, kFlatFirst };
std::span<const char* const> enum_names(Faces);

/// A rotating prism prism: one flat and one tilted face.
struct PrismConfig {
  double rpm = 0;
  double angle_deg = 0;
  double refractive_index = 1;
  Faces faces = Faces::kTiltedFirst;
  double phase_deg = 0;
};

/// Lasers that look through a row of rotating prisms.
struct PrismsConfig {
  double steps_per_s = 0;
  MotorPhase phase = MotorPhase::kFree;  ///< no vendor offers a lock
  int first_step = 0;
  double focal_length = 1;
  std::vector<double> laser_offsets;  ///< elevation is atan(offset / focal_length), from the top
  std::vector<PrismConfig> prisms;
};

/// Azimuth and elevation of ray after ray, repeated when it ends.
struct TableConfig {
  std::string file;
  double rays_per_s = 0;
  MotorPhase phase = MotorPhase::kFree;
  std::string digest;            ///< of the directions
  std::vector<Vec2> directions;  ///< resolved: azimuth, elevation (rad)
  std::vector<double> times_s;   ///< resolved: of each direction since the first; none: evenly
};

struct PatternConfig {
  std::optional<SpinningConfig> spinning;
  std::optional<PrismsConfig> prisms;
  std::optional<TableConfig> table;
};

/// CARLA's loss of points, with its names.
struct DropOffConfig {
  double general_rate = 0.45;
  double intensity_limit = 0.8;
  double zero_intensity_rate = 0.4;
};

/// A range that a vendor publishes.
struct PublishedRange {
  double range_m = 0;
  double reflectance = 0.1;
  double sunlight_klux = 100;
};

/// Detection by received power. The 10 % range is that in 100 klx.
struct DetectionConfig {
  double range_at_10_percent_m = 100;
  std::vector<PublishedRange> further_ranges;
  double steepness = 5;
};

/// All ranges that a vendor publishes, the 10 % range first.
std::vector<PublishedRange> published_ranges(const DetectionConfig& detection);
std::string range_text(const PublishedRange& r);

/// A beam wider than a ray, cast as several.
struct BeamConfig {
  double vertical_deg = 0;
  double horizontal_deg = 0;
  int sub_rays = 5;
};

inline constexpr double kLongestRange_m = 5000;  ///< of any LiDAR

struct ReturnsConfig {
  double min_range_m = 0;
  double max_range_m = 100;
  double range_accuracy_m = 0;
  std::optional<DropOffConfig> drop_off;
  std::optional<DetectionConfig> detection;
  std::optional<BeamConfig> beam;
};

struct PriceConfig {
  double low = 0;
  double high = 0;
  std::string source;
  std::string date;
};

/// One optical unit; a bundle has several, each turned on the common mount.
struct LidarUnit {
  double yaw_deg = 0;
  double pitch_deg = 0;
  PatternConfig pattern;
  ReturnsConfig returns;
};

struct LidarConfig {
  std::string name;
  std::string model;
  std::string preset;
  PriceConfig price_usd;
  std::vector<LidarUnit> units;
};

double rays_per_s(const PatternConfig& pattern);

/// Reads one preset of a LiDAR file; files it names are read too, relative to it.
/// @throws ConfigError, IoError
LidarConfig read_lidar(const std::filesystem::path& file, const std::string& preset);

/// Names of the presets in a LiDAR or scene file, in its order.
std::vector<std::string> preset_names(const std::filesystem::path& file);

/// Every key with its value as plain YAML, channels as read. That of one unit reads back, turned or
/// not; that of several has no price.
std::string dump_lidar(const LidarConfig& lidar);

/// The same by the canonical names of keys: what its frames are told by.
std::string canonical_lidar(const LidarConfig& lidar);
/// @param resolved the keys that `dump_lidar` wrote, of this version or an older one
std::string canonical_lidar(const config::Tree& resolved);

}  // namespace infrasim
