#include "infrasim/config/lidar_checks.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>

#include "infrasim/config/fields.h"

namespace infrasim {

namespace {

// minimum number of rows of a table that is checked; fewer rows may all lie within 1.6 degrees of
// the horizon
constexpr std::size_t kLeastRows = 8;
constexpr double kMostElevation_rad = kPi / 2 + 0.03;
constexpr double kMostAzimuth_rad = 2 * kPi + 0.03;

/// Returns the elevations of a unit's table, in degrees. The result is empty if an azimuth is above
/// 2 pi, because such angles cannot be radians.
std::vector<double> table_of(const PatternConfig& pattern) {
  std::vector<double> elevations;
  if (pattern.spinning && pattern.spinning->channels.count == 0)
    for (const Channel& channel : pattern.spinning->channels.table)
      elevations.push_back(channel.elevation_deg);
  if (!pattern.table || std::filesystem::path(pattern.table->file).extension() != ".csv")
    return elevations;
  for (const Vec2& direction : pattern.table->directions) {
    if (std::abs(direction.x) * 180 / kPi > kMostAzimuth_rad) return {};
    elevations.push_back(direction.y * 180 / kPi);
  }
  return elevations;
}

// maximum angle between two sub-rays of a beam; with a larger angle, targets are missed
constexpr double kMostSpacing_deg = 0.25;
constexpr double kLeastTable_s = 1;  // shorter tables count as patterns that repeat

/// Returns the number of full turns of the azimuth from the first row of a table through all rows
/// and back to the first row.
double turns_of(std::span<const Vec2> directions) {
  double sum = 0;
  for (std::size_t i = 0; i < directions.size(); ++i)
    sum += wrap_angle(directions[(i + 1) % directions.size()].x - directions[i].x);
  return std::round(sum / (2 * kPi));
}

}  // namespace

std::vector<std::string> angle_warnings(std::span<const LidarConfig> lidars) {
  std::vector<std::string> lines;
  for (const LidarConfig& lidar : lidars)
    for (const LidarUnit& unit : lidar.units) {
      const std::vector<double> elevations = table_of(unit.pattern);
      if (elevations.size() < kLeastRows) continue;
      const auto [low, high] = std::ranges::minmax(elevations);
      if (std::max(-low, high) > kMostElevation_rad) continue;
      std::string line = lidar.name + ": elevation_deg: expected degrees, got " +
                         std::to_string(elevations.size()) + " rows from " +
                         config::number_text(low) + " to " + config::number_text(high) +
                         ", which are probably radians";
      if (lines.empty() || lines.back() != line) lines.push_back(std::move(line));
    }
  return lines;
}

std::vector<std::string> repetition_warnings(std::span<const LidarConfig> lidars) {
  std::vector<std::string> lines;
  for (const LidarConfig& lidar : lidars)
    for (const LidarUnit& unit : lidar.units) {
      const auto& table = unit.pattern.table;
      if (!table || table->phase != MotorPhase::kFree) continue;
      const double period_s = static_cast<double>(table->directions.size()) / table->rays_per_s;
      if (period_s >= kLeastTable_s || std::abs(turns_of(table->directions)) == 1) continue;
      std::string line = lidar.name +
                         ": pattern.table: expected a pattern without repetition for " +
                         config::number_text(kLeastTable_s) + " s, as its phase is free, got " +
                         std::to_string(table->directions.size()) + " rows that repeat every " +
                         config::number_text(std::round(1e4 * period_s) / 1e4) +
                         " s; for a pattern that repeats, set phase: locked";
      if (lines.empty() || lines.back() != line) lines.push_back(std::move(line));
    }
  return lines;
}

bool sub_rays_miss_targets(double spacing_deg) { return spacing_deg > kMostSpacing_deg; }

std::vector<std::string> sub_ray_warnings(std::span<const LidarConfig> lidars) {
  std::vector<std::string> lines;
  for (const LidarConfig& lidar : lidars)
    for (const LidarUnit& unit : lidar.units) {
      const auto& beam = unit.returns.beam;
      if (!beam) continue;
      const double width_deg = std::max(beam->vertical_deg, beam->horizontal_deg);
      if (!sub_rays_miss_targets(width_deg / beam->sub_rays)) continue;
      std::string line =
          lidar.name + ": returns.beam.sub_rays: expected " +
          config::number_text(2 * std::ceil((width_deg / kMostSpacing_deg - 1) / 2) + 1) +
          " or more for a beam of " + config::number_text(width_deg) + " degrees, got " +
          std::to_string(beam->sub_rays) + ", between which small targets are missed";
      if (lines.empty() || lines.back() != line) lines.push_back(std::move(line));
    }
  return lines;
}

std::vector<std::string> lidar_warnings(std::span<const LidarConfig> lidars) {
  std::vector<std::string> lines = angle_warnings(lidars);
  for (const auto& more : {repetition_warnings(lidars), sub_ray_warnings(lidars)})
    lines.insert(lines.end(), more.begin(), more.end());
  return lines;
}

}  // namespace infrasim
