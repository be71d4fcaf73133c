#pragma once

#include <string_view>

namespace infrasim {

/// Version of the package, equal to that in `pyproject.toml`.
std::string_view version();

/// Version number of the frames. Frames with the same number are the same bytes for the same scene,
/// LiDAR, preset and seed. So folders, rows of results and checkpoints with the same number are
/// compatible.
///
/// The number increases by 1 when points, labels, objects, calibration or fields change for a scene
/// that could be simulated before (tests/golden shows it). It does not increase for a release, for
/// a new or renamed key, or for a scene that was rejected before. Frames of version 0.3 have the
/// number 3.
inline constexpr int kFramesVersion = 3;

}  // namespace infrasim
