#pragma once

#include "infrasim/sensor/scan_pattern.h"

namespace infrasim {

/// Extent of a pattern in its own frame. A pattern that sees across 180 degrees of azimuth has a
/// maximum above 180.
struct FieldOfView {
  double azimuth_min_deg, azimuth_max_deg, elevation_min_deg, elevation_max_deg;
};

/// Returns the bounding box of all directions of one second.
FieldOfView field_of_view(const ScanPattern& pattern);

}  // namespace infrasim
