#pragma once

#include <string_view>

namespace infrasim {

/// Version of the package, as `pyproject.toml` has it.
std::string_view version();

/// Number of the frames: those of one number are the same bytes for the same scene, LiDAR, preset
/// and seed, so folders, rows of results and checkpoints of one number go together.
///
/// Raised by 1 when the points, labels, objects, calibration or fields of a scene that could be
/// simulated before get other bytes (tests/golden shows it). Not raised by a release, by a key that
/// is new or has another name, or by a scene that was refused before. Frames of 0.3 have the
/// number 3.
inline constexpr int kFramesVersion = 3;

}  // namespace infrasim
