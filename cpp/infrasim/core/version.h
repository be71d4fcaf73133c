#pragma once

#include <string_view>

namespace infrasim {

/// Version of the package, equal to that in `pyproject.toml`.
std::string_view version();

/// Version number of the frames. Two versions of the simulator with the same number write the same
/// bytes for the same scene, LiDAR, preset and seed. Folders, rows of results and checkpoints with
/// the same number are therefore compatible.
///
/// The number increases by 1 when points, labels, objects, calibration or fields change for a
/// shipped scene (tests/golden shows it). It does not increase for a release, for a new or renamed
/// key, or for a scene that was rejected before. Frames of version 0.3 have the number 3.
///
/// The number does not increase for a correction that changes only frames of other scenes. In this
/// case, `folder_identity.cpp` refuses to add frames to earlier folders of such scenes. Corrections
/// since 0.3 concern:
/// - scenes with traffic at several junctions;
/// - scenes with rain or fog;
/// - scenes with parked or recorded vehicles whose gap below the body is modelled;
/// - LiDARs with a beam wider than that of the Livox Avia;
/// - frames from 1,000 on of LiDARs with `azimuth_step_deg`.
///
/// Further corrections since 0.3 concern only some geometries, and frames are added to earlier
/// folders without a check:
/// - echoes of a wide beam, or in front of a pane, within `min_range_m`;
/// - surfaces that end at an azimuth of exactly 180 degrees;
/// - vehicles on a slope, at the end of a LiDAR's range.
///
/// Rows of results and checkpoints contain only the number.
inline constexpr int kFramesVersion = 3;

}  // namespace infrasim
