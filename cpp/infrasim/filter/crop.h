#pragma once

#include <array>
#include <span>
#include <vector>

#include "infrasim/core/geometry.h"

namespace infrasim {

/// Keeps points with min_m <= p <= max_m on every axis.
struct CropBox {
  std::array<double, 3> min_m{};
  std::array<double, 3> max_m{};
};

/// Keeps points whose x y lies inside a simple polygon (no crossing edges, either direction of
/// turn, closed by itself). A point on the outline may fall on either side.
struct CropPolygon {
  std::vector<Vec2> outline_m;
};

/// Keeps points with min_m <= slant range <= max_m.
struct CropRange {
  double min_m = 0;
  double max_m = 0;
};

/// Keeps points seen in an interval of azimuth and of elevation. Azimuth runs from min towards +y
/// up to max; min > max means through 180 degrees.
struct CropFieldOfView {
  double azimuth_min_deg = -180;
  double azimuth_max_deg = 180;
  double elevation_min_deg = -90;
  double elevation_max_deg = 90;
};

/// Indices of the points to keep, in increasing order; NaN and infinite points are never kept.
/// @param xyz  row-major points, metres, levelled LiDAR frame (origin at the sensor)
/// @throws std::invalid_argument if bounds are not numbers or cross, or a polygon has no area
std::vector<int> keep(std::span<const float> xyz, const CropBox& box);
std::vector<int> keep(std::span<const float> xyz, const CropPolygon& polygon);
std::vector<int> keep(std::span<const float> xyz, const CropRange& range);
std::vector<int> keep(std::span<const float> xyz, const CropFieldOfView& view);

}  // namespace infrasim
