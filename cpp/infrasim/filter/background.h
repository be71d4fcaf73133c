#pragma once

#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "infrasim/core/filter_steps.h"

namespace infrasim {

inline constexpr float kUnseen = std::numeric_limits<float>::infinity();

/// The static scene as seen by one fixed sensor. Each cell of azimuth and elevation has two bounds.
/// The model needs no beam table, so it supports any scan pattern.
struct BackgroundModel {
  int azimuth_cells = 0;
  int elevation_cells = 0;
  /// points at a larger range are background; kUnseen for a cell without a background
  std::vector<float> range_m;
  /// points at a lower height are background; -kUnseen if the surface is not level
  std::vector<float> height_m;
};

/// Learns the background from frames of one fixed sensor. `frames_xyz[i]` are row-major points.
/// Objects that stand still most of the time become background, including parked vehicles. In dense
/// traffic some tens of frames are required, spread over minutes. If the scan pattern does not
/// repeat, about a hundred frames are required. A cell without returns gets the farthest range and
/// the lowest height of its neighbours, so that it removes as few points as possible.
///
/// The range of beams that graze the ground changes by metres across one cell. A level surface
/// below the sensor is therefore bounded by its height. Any other surface is bounded by its range
/// minus the change of range to the next cells. The change is ignored if the neighbours on both
/// sides do not agree on it, as at the edge of a pole.
/// @throws std::invalid_argument if there is no frame or a parameter is out of its range
BackgroundModel learn_background(std::span<const std::vector<float>> frames_xyz,
                                 const BackgroundLearning& learning = {});

/// Removes the background. Points in cells without background are kept, because those cells never
/// had a return.
/// @return indices of the points to keep, in increasing order; only returns are kept
std::vector<int> keep(std::span<const float> xyz, const BackgroundModel& model);

/// Returns a model as bytes: the text line "infrasim-background 1"; int32 azimuth cells, elevation
/// cells, first stored elevation row and number of stored rows; range_m and height_m of these rows
/// as float32. Little-endian. Rows that are not stored have no background.
std::string background_to_bytes(const BackgroundModel& model);

/// Returns whether the bytes begin like a background model.
bool is_background(std::string_view bytes);

/// Returns the model in the bytes that background_to_bytes made.
/// @param name  path of the file, for messages
/// @throws ConfigError if the bytes are not a complete and plausible model
BackgroundModel background_from_bytes(std::string_view bytes, const std::string& name);

}  // namespace infrasim
