#pragma once

#include <span>
#include <vector>

namespace infrasim {

/// Keeps points above a road-level height: z > z_m, levelled LiDAR frame. It knows no slope.
struct GroundHeight {
  double z_m = 0;
};

/// Removes the points within `distance_m` of the largest plane that is at most `max_tilt_deg` from
/// horizontal (RANSAC of PCL, always with the same draws). It removes **one** plane: on an
/// embankment the road goes, slopes and terrain stay. Without such a plane every point is kept.
/// It needs the ground: after another ground filter the largest plane is a roof.
struct GroundPlane {
  double distance_m = 0.25;
  double max_tilt_deg = 10;
};

/// Removes the ground by a morphological opening: what is as wide as a square of `window_m` is
/// ground, and points up to `height_m` above it are removed. So vehicles, narrower than the window,
/// stay; roads, slopes and terrain go, and so do roofs wider than the window.
/// Points farther than `max_range_m` (horizontal) are kept. It needs the ground, as GroundPlane.
///
/// Measured on 128 lines to 100 m, flat road and embankments (tests/cpp/test_filter.cpp), vehicle
/// points kept / ground points removed:
/// - this filter: 99.8 to 100 / 99.5 to 100 %, 25 ms for 80k points;
/// - PCL's ProgressiveMorphologicalFilter (octree search per point): 99.4 / 100 % on flat
///   road, 9 s;
/// - PCL's ApproximateProgressiveMorphologicalFilter, cells of 0.5 m: with a window of 9 m 88 to
///   98 % of the vehicles, because it ignores empty cells and so a roof with its shadow is wide;
///   with 17 m 99.9 / 98.6 % in 240 to 400 ms, but 79 % of the ground of a 10 m road on a bank;
/// - an opening in polar cells (range x azimuth): 94 % of the ground, as slopes are not flat there.
/// Near the edge of a narrow field of view, a vehicle cut by the edge may pass for ground.
struct GroundMorphological {
  double window_m = 6;
  double height_m = 0.25;
  double cell_m = 0.3;
  double azimuth_cell_deg = 0.5;  ///< of the rays along which gaps between returns are filled
  double max_range_m = 300;       ///< at most 2000 cells
};

/// Indices of the points to keep, in increasing order; NaN and infinite points are never kept.
/// @param xyz  row-major points, metres, levelled LiDAR frame (origin at the sensor)
/// @throws std::invalid_argument if a parameter is out of its range
std::vector<int> keep(std::span<const float> xyz, const GroundHeight& ground);
std::vector<int> keep(std::span<const float> xyz, const GroundPlane& ground);
std::vector<int> keep(std::span<const float> xyz, const GroundMorphological& ground);

}  // namespace infrasim
