#pragma once

#include <filesystem>
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
  std::vector<double> z;        ///< m, of each sample of the line
  std::vector<double> width_m;  ///< of each sample of the line

  /// Of z or width_m, at a station of the line.
  double at(const std::vector<double>& values, double s) const;
};

/// Lanes of a file with the columns lane,x,y,z,width: rows of one lane stand together.
/// @throws IoError; ConfigError for a lane of one row, in two places, or with two rows at one point
std::vector<LanePath> read_lanes(const std::filesystem::path& file);

/// Those of the scene's `lanes`; none without the key.
std::vector<LanePath> lanes_of(const SceneConfig& scene);

/// A lane at its point that is nearest to a place.
struct LaneLevel {
  double away = 0;      ///< m from the place, horizontally
  bool beyond = false;  ///< the place lies before or behind it
  double half_width = 0;
  double z = 0;
};

/// Of each of some lanes.
std::vector<LaneLevel> lane_levels(std::span<const LanePath> lanes, Vec2 place);

}  // namespace infrasim
