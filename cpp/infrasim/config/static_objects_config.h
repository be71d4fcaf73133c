#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "infrasim/config/tree.h"
#include "infrasim/core/geometry.h"

// Meshes, buildings, barriers, gantries and vegetation in the scene file.

namespace infrasim {

/// The material of a mesh. The numbers are those of the point classes in Class.
enum class Material { kRoad, kSidewalk, kTerrain, kStructure, kVegetation };

std::span<const char* const> enum_names(Material);

/// A surface from a file, in the world frame.
struct MeshConfig {
  std::string file;  ///< path of a .ply file, relative to the scene file
  Material material = Material::kStructure;
  config::Place place;
  config::KeyPlace file_key;
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
  double offset_m = 0;  ///< offset from the centreline, positive to the left
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
  double offset_m = 0;  ///< offset from the centreline, positive to the left
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
  double offset_m = 0;  ///< offset from the centreline, positive to the left
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

}  // namespace infrasim
