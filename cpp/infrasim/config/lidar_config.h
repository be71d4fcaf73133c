#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "infrasim/config/tree.h"
#include "infrasim/core/fraction.h"
#include "infrasim/core/geometry.h"

// The keys of a LiDAR file, read for one of its presets.

namespace infrasim {

inline constexpr int kMostColumnStep = 16;
inline constexpr double kLongestPublishedRange_m = 2000;
inline constexpr double kLongestMinRange_m = 1000;

/// One laser of a spinning sensor. It fires in every column_step-th column, beginning with
/// first_column.
struct Channel {
  double elevation_deg = 0;
  double azimuth_offset_deg = 0;  ///< azimuth offset, positive in the direction of rotation
  double fire_time_us = 0;        ///< firing time after the start of the column
  int column_step = 1;
  int first_column = 0;
  /// range of this channel on a target with a reflectance of 10 %; if missing, the LiDAR's range
  /// applies
  std::optional<double> range_at_10_percent_m = std::nullopt;
  /// minimum range of this channel; if missing, the LiDAR's minimum range applies
  std::optional<double> min_range_m = std::nullopt;
};

/// Channels of a spinning sensor: from a file, or evenly spaced from upper_deg down to lower_deg.
struct ChannelsConfig {
  std::string file;
  int count = 0;
  std::optional<double> upper_deg;  ///< elevation of the first channel; if missing, 0
  std::optional<double> lower_deg;
  /// channels that were read from the file or calculated from the other members
  std::vector<Channel> table;
  config::KeyPlace file_key = {};
};

inline constexpr double kUsualPeriod_s = 0.1;  ///< frame period of most LiDARs
inline constexpr double kShortestPeriod_s = 0.05, kLongestPeriod_s = 0.2;

/// How a scan pattern starts: at a given position (locked) or at a random one (free). The random
/// position depends on the seed, the mount and the LiDAR unit.
enum class MotorPhase { kLocked, kFree };
std::span<const char* const> enum_names(MotorPhase);

/// A sensor that turns clockwise seen from above, as all spinning sensors of the catalogue do.
/// Exactly one of azimuth_step_deg, columns_per_turn and cycle_us is set.
struct SpinningConfig {
  double rate_hz = 10;
  MotorPhase phase = MotorPhase::kLocked;  ///< a locked motor is at cut_angle_deg at time 0
  /// azimuth at which a frame begins and ends, in the frame of the LiDAR unit
  double cut_angle_deg = 180;
  std::optional<double> azimuth_step_deg;
  /// exact number of columns per turn; the azimuths of columns repeat after `denominator` turns
  std::optional<Fraction> columns_per_turn;
  std::optional<double> cycle_us;  ///< time between two columns; it does not depend on rate_hz
  ChannelsConfig channels;
};
double columns_per_s(const SpinningConfig& spinning);
/// Returns the number of columns per turn as an exact fraction. If the file gives a step in
/// degrees, the fraction is found from the step: 0.2 means 1800 columns per turn, although the
/// floating-point number only approximates 360 / 1800. Returns no value if no fraction with a
/// denominator up to 16 fits the step. If the file gives cycle_us, the fraction is exact for its
/// decimal text: 55.296 us at 10 Hz give 390625/216 columns per turn.
std::optional<Fraction> columns_per_turn(const SpinningConfig& spinning);
/// Returns the number of columns after which the same channels fire again: the least common
/// multiple of all column_step.
int columns_per_group(const SpinningConfig& spinning);

enum class Faces { kTiltedFirst, kFlatFirst };
std::span<const char* const> enum_names(Faces);

/// A rotating prism with one flat and one tilted face.
struct PrismConfig {
  double rpm = 0;
  double angle_deg = 0;
  double refractive_index = 1;
  Faces faces = Faces::kTiltedFirst;
  double phase_deg = 0;
};

/// Lasers behind a row of rotating prisms.
struct PrismsConfig {
  double steps_per_s = 0;
  double period_s = kUsualPeriod_s;  ///< frame period
  /// random start by default, because no vendor of such LiDARs offers a phase lock
  MotorPhase phase = MotorPhase::kFree;
  int first_step = 0;
  double focal_length = 1;
  /// offsets of the lasers from top to bottom; the elevation of a laser is atan(offset /
  /// focal_length)
  std::vector<double> laser_offsets;
  std::vector<PrismConfig> prisms;
};

/// Directions of consecutive rays. After the last row, the table starts again at its first row.
struct TableConfig {
  std::string file;
  double rays_per_s = 0;
  double period_s = kUsualPeriod_s;  ///< frame period
  MotorPhase phase = MotorPhase::kFree;
  std::string digest;  ///< digest of the directions and times
  /// azimuth and elevation of each ray in radians, read from the file
  std::vector<Vec2> directions;
  /// time of each ray since the first ray, read from the file; if empty, the times are evenly
  /// spaced
  std::vector<double> times_s;
  config::KeyPlace file_key = {};
};

struct PatternConfig {
  std::optional<SpinningConfig> spinning;
  std::optional<PrismsConfig> prisms;
  std::optional<TableConfig> table;
};

/// Random loss of points. The model and the names of its parameters are those of the simulator
/// CARLA.
struct DropOffConfig {
  double general_rate = 0.45;
  double intensity_limit = 0.8;
  double zero_intensity_rate = 0.4;
};

/// A range that a vendor publishes for a target with a given reflectance in given sunlight.
struct PublishedRange {
  double range_m = 0;
  double reflectance = 0.1;
  double sunlight_klux = 100;
};

/// In sunlight, the maximum range is by default proportional to this power of the reflectance.
inline constexpr double kLawExponent = 0.25;
inline constexpr double kLeastExponent = 0.25, kMostExponent = 0.5;

/// Detection by received power. The range on a target of 10 % reflectance applies to sunlight of
/// 100 klx.
struct DetectionConfig {
  double range_at_10_percent_m = 100;
  std::vector<PublishedRange> further_ranges;
  /// power of the reflectance with which the range grows; allowed only without further_ranges;
  /// default: kLawExponent
  std::optional<double> law_exponent = std::nullopt;
  double steepness = 5;
};

/// Returns all published ranges. The first one is the range on a target of 10 % reflectance.
std::vector<PublishedRange> published_ranges(const DetectionConfig& detection);
std::string range_text(const PublishedRange& r);

/// Where a beam is cast as several sub-rays: only near moving objects, or in the whole scene. Any
/// other beam is cast as one ray.
enum class BeamWhere { kMoving, kEverywhere };
std::span<const char* const> enum_names(BeamWhere);

/// A beam with a divergence, cast as several rays.
struct BeamConfig {
  double vertical_deg = 0;
  double horizontal_deg = 0;
  int sub_rays = 3;  ///< number of sub-rays across the beam; an odd number
  BeamWhere where = BeamWhere::kMoving;
};

/// Which echoes of a ray become points.
enum class EchoMode { kStrongest, kFirst, kLast, kDual };
std::span<const char* const> enum_names(EchoMode);

/// How a LiDAR that detects by received power selects from the echoes of a ray.
struct EchoesConfig {
  EchoMode mode = EchoMode::kStrongest;
  /// minimum distance between two echoes; closer echoes merge; the default is the length of a pulse
  /// of 3 ns
  double separation_m = 0.5;
  /// modes that the sensor offers; if empty, the sensor offers all modes
  std::vector<EchoMode> offered;
};

inline constexpr double kLongestRange_m = 5000;  ///< longest allowed range of a LiDAR

struct ReturnsConfig {
  double min_range_m = 0;
  double max_range_m = 100;
  double range_accuracy_m = 0;
  std::optional<DropOffConfig> drop_off;
  std::optional<DetectionConfig> detection;
  std::optional<BeamConfig> beam;
  std::optional<EchoesConfig> echoes;
  /// whether each hit within the range limits is detected, in any weather; not a key of a file
  bool every_hit = false;
};

struct PriceConfig {
  double low = 0;
  double high = 0;
  std::string source;
  std::string date;
};

/// One optical unit. A bundle has several units, each rotated on the common mount.
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

/// Returns the frame period: the time of one turn of a spinning unit, or the value of period_s. All
/// units of a LiDAR have the same period.
double period_s(const PatternConfig& pattern);
double period_s(const LidarConfig& lidar);
/// Returns the common frame period of several LiDARs; kUsualPeriod_s if there is no LiDAR.
/// @throws ConfigError if the periods differ
double period_s(std::span<const LidarConfig> lidars);

/// Reads a LiDAR file under one of its presets. Paths in the file are relative to the file.
/// @throws ConfigError, IoError
LidarConfig read_lidar(const std::filesystem::path& file, const std::string& preset);

/// Returns the names of the presets in a LiDAR or scene file, in the file's order.
std::vector<std::string> preset_names(const std::filesystem::path& file);

/// Returns every key with its value as YAML. Files of channels are replaced by the channels
/// themselves. The text can be read back as a LiDAR file.
std::string dump_lidar(const LidarConfig& lidar);

/// Like dump_lidar, but with the canonical names of keys (those of version 0.3), and without the
/// price of several units. The text identifies the frames of the LiDAR.
std::string canonical_lidar(const LidarConfig& lidar);
/// @param resolved keys written by `dump_lidar` of this version or an older one
std::string canonical_lidar(const config::Tree& resolved);

}  // namespace infrasim
