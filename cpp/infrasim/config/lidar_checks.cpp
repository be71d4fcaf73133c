#include "infrasim/config/lidar_checks.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>

#include "infrasim/config/fields.h"

namespace infrasim {

namespace {

constexpr std::size_t kLeastRows = 8;  // LiDARs of a few lines may see less than 3.2 degrees
constexpr double kMostElevation_rad = kPi / 2 + 0.03;
constexpr double kMostAzimuth_rad = 2 * kPi + 0.03;

/// Returns the elevations of a unit's table, in the unit of the file. They are empty if all
/// azimuths of a table of directions are not also in the range of radians.
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

}  // namespace infrasim
