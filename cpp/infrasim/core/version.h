#pragma once

#include <string_view>

namespace infrasim {

/// Returns the version of the package, the same as in `pyproject.toml`.
std::string_view version();

/// Version number of the frames. Two versions of the simulator with the same number write the same
/// bytes for the same scene, LiDAR, preset and seed. Folders, rows of results and checkpoints with
/// the same number are therefore compatible.
///
/// The number increases by 1 when points, labels, objects, calibration or fields change for a scene
/// that could already be simulated. The number does not increase for a release, for a new or
/// renamed key, or for a scene that was rejected before. Frames of versions 0.3 and 0.4 have the
/// number 3.
inline constexpr int kFramesVersion = 4;

}  // namespace infrasim
