#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace infrasim {

/// Cells and margins of a background model. Cells are about as large as the step between beams; a
/// vehicle loses a strip as high as a cell (0.2 degrees: 0.3 m at 90 m) where it touches the road.
struct BackgroundGrid {
  double azimuth_cell_deg = 0.4;
  double elevation_cell_deg = 0.2;
  double range_margin_m = 0.3;    ///< closer than this before the background is still background
  double height_margin_m = 0.15;  ///< the same above a level surface
  /// A cell's background is the farthest of its returns but for this share. So it is found even if
  /// vehicles hide it in most frames (a queue at a red light), and stray far echoes do not move it.
  double far_share = 0.1;
};

/// Static scene as one fixed sensor sees it, learned from frames: for each cell of azimuth and
/// elevation, the range of the background and, if it is a level surface below the sensor, its
/// height. Beams that graze the ground need the height: across one cell their range changes by
/// metres, and the height does not. It needs no beam table, so it serves any scan pattern.
struct BackgroundModel {
  BackgroundGrid grid;
  int azimuth_cells = 0;
  int elevation_cells = 0;
  std::vector<float> range_m;   ///< elevation-major; +inf where nothing was seen
  std::vector<float> height_m;  ///< -inf where the background is not level or not seen
};

/// A model that has seen nothing.
/// @throws std::invalid_argument if a parameter is out of its range
BackgroundModel empty_background(const BackgroundGrid& grid);

/// Learns the background from frames of one sensor in one place, `frames_xyz[i]` row-major points.
/// What stands still all the time becomes background, parked vehicles too. Some tens of frames,
/// spread over minutes, are needed where traffic is dense. A cell no frame saw takes the farthest
/// of its seen neighbours; without any it stays unseen.
/// @throws std::invalid_argument if there is no frame or a parameter is out of its range
BackgroundModel learn_background(std::span<const std::vector<float>> frames_xyz,
                                 const BackgroundGrid& grid = {});

/// Removes what is not in front of the background. Points in unseen cells are kept (the sky: there
/// was never a return, so anything is new).
/// @return indices of the points to keep, in increasing order; never NaN or infinite ones
std::vector<int> keep(std::span<const float> xyz, const BackgroundModel& model);

/// A model as bytes: the text line "infrasim-background 1", five float64 of the grid, two int32 of
/// the numbers of cells, then both arrays as float32; little-endian.
std::string background_to_bytes(const BackgroundModel& model);

/// True if bytes begin as a background model does.
bool is_background(std::string_view bytes);

/// @param name  the file's path, for messages
/// @throws ConfigError if the bytes are not a whole and sane model
BackgroundModel background_from_bytes(std::string_view bytes, const std::string& name);

}  // namespace infrasim
