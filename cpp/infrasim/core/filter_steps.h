#pragma once

#include <array>
#include <variant>
#include <vector>

#include "infrasim/core/geometry.h"

// Parameters of the point filters. Their default values are defined only here. Scenes and the
// command line set the parameters; filter/ implements the filters.

namespace infrasim {

/// Keeps points with min_m <= p <= max_m on every axis.
struct CropBox {
  std::array<double, 3> min_m{};
  std::array<double, 3> max_m{};
};

/// Keeps points whose x and y lie inside a simple polygon. The edges of the polygon must not cross.
/// The corners may be in clockwise or counter-clockwise order, and the polygon is closed
/// automatically. A point on the outline may count as inside or outside.
struct CropPolygon {
  std::vector<Vec2> outline_m;
};

/// Keeps points with min_m <= slant range <= max_m.
struct CropRange {
  double min_m = 0;
  double max_m = 0;
};

/// Keeps points within an interval of azimuth and an interval of elevation. The azimuth is 0 along
/// +x and increases towards +y. The azimuth interval goes from azimuth_min_deg, in the direction of
/// increasing azimuth, to azimuth_max_deg. If azimuth_min_deg > azimuth_max_deg, the interval
/// contains 180 degrees.
struct CropFieldOfView {
  double azimuth_min_deg = -180;
  double azimuth_max_deg = 180;
  double elevation_min_deg = -90;
  double elevation_max_deg = 90;
};

/// Keeps points above a constant height, z > z_m in the levelled LiDAR frame. Slopes are ignored.
struct GroundHeight {
  double z_m = 0;
};

/// Removes the points within `distance_m` of the largest nearly horizontal plane (tilt up to
/// `max_tilt_deg`). PCL's RANSAC finds the plane with a fixed random seed. The plane must lie
/// `sensor_height_m` below the sensor, with a tolerance of 0.5 m. If `sensor_height_m` is 0, a
/// plane at any height is accepted. On an embankment, the plane is then the road or the terrain,
/// whichever has more points. In a scene file, 0 means the mount's height above the first road. The
/// filter removes only one plane. If no plane is found, every point is kept. The filter must run
/// before any other ground filter, because without ground points the largest plane is a roof.
struct GroundPlane {
  double distance_m = 0.25;
  double sensor_height_m = 0;
  double max_tilt_deg = 10;
};

/// Removes the ground by a morphological opening. Surfaces at least as wide as a square of
/// `window_m` are ground, and points up to `height_m` above them are removed. Vehicles are narrower
/// than the window, so their points are kept. Roads, slopes, terrain, and roofs wider than the
/// window are removed. Points farther than `max_range_m` (horizontal) are kept. Like GroundPlane,
/// the filter must run before any other ground filter.
///
/// The filters were compared with a 128-line LiDAR up to 100 m, on a flat road and on embankments
/// (tests/cpp/test_filter.cpp). The two percentages are vehicle points kept / ground points
/// removed:
/// - this filter: 99.8 to 100 / 99.5 to 100 %, 22 to 36 ms for 80k points;
/// - PCL's ProgressiveMorphologicalFilter (octree search per point): 99.4 / 100 % on a flat
///   road, 9 s;
/// - PCL's ApproximateProgressiveMorphologicalFilter with 0.5 m cells and a window of 9 m keeps 88
///   to 98 % of the vehicle points. It ignores empty cells, so that a roof and its shadow together
///   count as a wide surface. With a window of 17 m it has 99.9 / 98.6 % in 240 to 400 ms, but it
///   removes only 79 % of the ground of a 10 m wide road on an embankment;
/// - an opening in polar cells (range x azimuth) removes 94 % of the ground, because slopes are not
///   flat in polar cells.
/// A vehicle that is cut by the edge of a narrow field of view may count as ground.
struct GroundMorphological {
  double window_m = 6;
  double height_m = 0.25;
  double cell_m = 0.3;
  /// width of the azimuth sectors along which the gaps between returns are filled
  double azimuth_cell_deg = 0.5;
  double max_range_m = 300;  ///< maximum range of removed points, at most 2000 times cell_m
};

/// Parameters for learning a background. A cell should be about as large as the angle between two
/// neighbouring beams.
struct BackgroundLearning {
  double azimuth_cell_deg = 0.2;
  double elevation_cell_deg = 0.2;
  /// points that are at most this much nearer than the background count as background
  double range_margin_m = 0.3;
  double height_margin_m =
      0.15;  ///< points at most this far above a level surface count as background
};

/// A background learnt from frames of the scene without vehicles.
struct BackgroundFilter : BackgroundLearning {
  int frames = 20;
};

/// Any one of the filters. `Background` is the type of the background filter: the learning
/// configuration in a scene file, or the learnt model when points are filtered.
template <class Background>
using FilterOf = std::variant<CropBox, CropPolygon, CropRange, CropFieldOfView, GroundHeight,
                              GroundPlane, GroundMorphological, Background>;

}  // namespace infrasim
