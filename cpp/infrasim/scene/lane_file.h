#pragma once

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "infrasim/config/scene_config.h"
#include "infrasim/scene/curve.h"

namespace infrasim {

/// A lane's centreline in the direction of travel; world frame.
struct LanePath {
  std::string name;
  Curve line;
  std::vector<double> z;        ///< metres, at each sample of the line
  std::vector<double> width_m;  ///< at each sample of the line

  /// Interpolates z or width_m at a station of the line.
  /// @param less compares two stations; a binary search calls it about log2(samples) times
  template <class Less = std::less<>>
  double at(const std::vector<double>& values, double s, Less less = {}) const {
    const auto& stations = line.stations();
    const auto end = std::lower_bound(stations.begin() + 1, stations.end(), s, less);
    if (end == stations.end()) return values.back();
    const auto i = static_cast<std::size_t>(end - stations.begin()) - 1;
    const double step = norm(line.samples()[i + 1].position - line.samples()[i].position);
    return values[i] + std::clamp((s - stations[i]) / step, 0.0, 1.0) * (values[i + 1] - values[i]);
  }
};

/// Reads lanes from a file with the columns lane,x,y,z,width. Rows of one lane must be consecutive.
/// @throws IoError; ConfigError for a lane with one row, with rows in two parts of the file, or
///   with two rows at one point
std::vector<LanePath> read_lanes(const std::filesystem::path& file);

/// Returns the lanes in the scene's `lanes` file; empty if the scene does not have this key.
std::vector<LanePath> lanes_of(const SceneConfig& scene);

/// The point of a lane nearest to a position.
struct LaneLevel {
  double away = 0;      ///< horizontal distance from the position, metres
  bool beyond = false;  ///< whether the position lies before the start or after the end of the lane
  double half_width = 0;
  double z = 0;
};

/// Returns the point of each lane that is nearest to `place`.
std::vector<LaneLevel> lane_levels(std::span<const LanePath> lanes, Vec2 place);

}  // namespace infrasim
