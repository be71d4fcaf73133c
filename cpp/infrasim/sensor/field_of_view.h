#pragma once

#include "infrasim/sensor/scan_pattern.h"

namespace infrasim {

/// Limits of a scan pattern's directions, in the frame of the LiDAR unit. If the field of view
/// extends across an azimuth of 180 degrees, azimuth_max_deg is above 180.
struct FieldOfView {
  double azimuth_min_deg, azimuth_max_deg, elevation_min_deg, elevation_max_deg;
};

/// Returns the limits of all directions in one cycle of the pattern: one turn, all rows of a table,
/// or 1 s for prisms.
FieldOfView field_of_view(const ScanPattern& pattern);

}  // namespace infrasim
