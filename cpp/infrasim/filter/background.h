#pragma once

#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "infrasim/core/filter_steps.h"

namespace infrasim {

inline constexpr float kUnseen = std::numeric_limits<float>::infinity();

/// The static scene as seen by one fixed sensor: two bounds for each cell of azimuth and elevation.
/// It needs no beam table, so it works with any scan pattern.
struct BackgroundModel {
  int azimuth_cells = 0;
  int elevation_cells = 0;
  /// farther points are background; kUnseen for a cell that was never seen
  std::vector<float> range_m;
  /// lower points are background; -kUnseen if the surface is not level
  std::vector<float> height_m;
};

/// Learns the background from frames of one fixed sensor. `frames_xyz[i]` are row-major points.
/// Objects that stand still most of the time become background, including parked vehicles. In dense
/// traffic some tens of frames are needed, spread over minutes; about a hundred if the scan pattern
/// does not repeat. A cell that no frame saw takes those bounds of its neighbours that remove
/// least.
///
/// The range of beams that graze the ground changes by metres across one cell. So a level surface
/// below the sensor is bounded by its height. Any other surface is bounded by its range minus the
/// change of range to the next cells, if both sides agree on one (they do not at the edge of a
/// pole).
/// @throws std::invalid_argument if there is no frame or a parameter is out of its range
BackgroundModel learn_background(std::span<const std::vector<float>> frames_xyz,
                                 const BackgroundLearning& learning = {});

/// Removes the background. Points in cells without background are kept, because those cells never
/// had a return.
/// @return indices of the points to keep, in increasing order, without NaN or infinite points
std::vector<int> keep(std::span<const float> xyz, const BackgroundModel& model);

/// A model as bytes: the text line "infrasim-background 1"; int32 azimuth cells, elevation cells,
/// first stored elevation row and number of stored rows; range_m and height_m of these rows as
/// float32. Little-endian. Rows that are not stored have no background.
std::string background_to_bytes(const BackgroundModel& model);

/// True if the bytes begin like a background model.
bool is_background(std::string_view bytes);

/// @param name  path of the file, for messages
/// @throws ConfigError if the bytes are not a complete and plausible model
BackgroundModel background_from_bytes(std::string_view bytes, const std::string& name);

}  // namespace infrasim
