#pragma once

#include <array>
#include <variant>
#include <vector>

#include "infrasim/core/geometry.h"

// Parameters of the point filters, and their only defaults: scenes and the command line set them,
// filter/ carries them out.

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

/// Keeps points above a road-level height: z > z_m, levelled LiDAR frame. It knows no slope.
struct GroundHeight {
  double z_m = 0;
};

/// Removes the points within `distance_m` of the largest plane that is at most `max_tilt_deg` from
/// horizontal (RANSAC of PCL, always with the same draws) and passes below the sensor where it
/// should, within 0.5 m. With a `sensor_height_m` of 0 nobody knows where that is and the largest
/// plane goes: on an embankment the road or the terrain, whichever has more points. In a scene 0
/// stands for the mount's height above the first road. It removes **one** plane; without such a
/// plane every point is kept. It needs the ground: after another ground filter the largest plane is
/// a roof.
struct GroundPlane {
  double distance_m = 0.25;
  double sensor_height_m = 0;
  double max_tilt_deg = 10;
};

/// Removes the ground by a morphological opening: what is as wide as a square of `window_m` is
/// ground, and points up to `height_m` above it are removed. So vehicles, narrower than the window,
/// stay; roads, slopes and terrain go, and so do roofs wider than the window.
/// Points farther than `max_range_m` (horizontal) are kept. It needs the ground, as GroundPlane.
///
/// Measured on 128 lines to 100 m, flat road and embankments (tests/cpp/test_filter.cpp), vehicle
/// points kept / ground points removed:
/// - this filter: 99.8 to 100 / 99.5 to 100 %, 22 to 36 ms for 80k points;
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

/// How a background is learned. Cells are about as large as the step between beams.
struct BackgroundLearning {
  double azimuth_cell_deg = 0.2;
  double elevation_cell_deg = 0.2;
  double range_margin_m = 0.3;    ///< closer than this before the background is still background
  double height_margin_m = 0.15;  ///< the same above a level surface
};

/// A background learnt from frames of a scene without vehicles.
struct BackgroundFilter : BackgroundLearning {
  int frames = 20;
};

/// Every filter, once. `Background` is how one is learnt in a scene, and what was learnt where
/// points are filtered.
template <class Background>
using FilterOf = std::variant<CropBox, CropPolygon, CropRange, CropFieldOfView, GroundHeight,
                              GroundPlane, GroundMorphological, Background>;

}  // namespace infrasim
