#pragma once

#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "infrasim/core/filter_steps.h"

namespace infrasim {

inline constexpr float kUnseen = std::numeric_limits<float>::infinity();

/// The static scene as one fixed sensor sees it: two bounds for each cell of azimuth and elevation.
/// It needs no beam table, so it serves any scan pattern.
struct BackgroundModel {
  int azimuth_cells = 0;
  int elevation_cells = 0;
  std::vector<float> range_m;   ///< points farther are background; kUnseen where it was not seen
  std::vector<float> height_m;  ///< points lower are background; -kUnseen where it is not level
};

/// Learns the background from frames of one sensor in one place, `frames_xyz[i]` row-major points.
/// What stands still most of the time becomes background, parked vehicles too. Some tens of frames,
/// spread over minutes, are needed where traffic is dense; about a hundred if the pattern does not
/// repeat. A cell that no frame saw takes the bounds of its neighbours that remove least.
///
/// Beams that graze the ground change their range by metres across one cell. So a level surface
/// below the sensor is bounded by its height, and any other by its range less the change of range
/// to the next cells, if both sides agree on one (at the edge of a pole they do not).
/// @throws std::invalid_argument if there is no frame or a parameter is out of its range
BackgroundModel learn_background(std::span<const std::vector<float>> frames_xyz,
                                 const BackgroundLearning& learning = {});

/// Removes the background. Points in cells without one are kept: there was never a return, so
/// anything is new.
/// @return indices of the points to keep, in increasing order; never NaN or infinite ones
std::vector<int> keep(std::span<const float> xyz, const BackgroundModel& model);

/// A model as bytes: the text line "infrasim-background 1"; int32 cells of azimuth, cells of
/// elevation, first stored row and number of rows of elevation; range_m and height_m of these rows
/// as float32. Little-endian; rows that are not stored have no background.
std::string background_to_bytes(const BackgroundModel& model);

/// True if bytes begin as a background model does.
bool is_background(std::string_view bytes);

/// @param name  the file's path, for messages
/// @throws ConfigError if the bytes are not a whole and sane model
BackgroundModel background_from_bytes(std::string_view bytes, const std::string& name);

}  // namespace infrasim
