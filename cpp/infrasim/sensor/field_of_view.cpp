#include "infrasim/sensor/field_of_view.h"

#include <algorithm>
#include <tuple>
#include <utility>
#include <vector>

#include "infrasim/core/math.h"

namespace infrasim {

namespace {

/// Returns the lower and the upper limit of the narrowest interval that contains all given
/// azimuths, in degrees. An interval across 180 degrees, which ends above 180, is used only if it
/// is more than kLeastGain_deg narrower than the interval without 180 degrees.
std::pair<double, double> azimuth_span(std::vector<double> azimuths) {
  constexpr double kLeastGain_deg = 1;
  std::ranges::sort(azimuths);
  double low = azimuths.front(), high = azimuths.back();
  double narrowest = high - low - kLeastGain_deg;
  for (std::size_t i = 1; i < azimuths.size(); ++i) {
    const double width = azimuths[i - 1] + 360 - azimuths[i];
    if (width >= narrowest) continue;
    narrowest = width;
    low = azimuths[i];
    high = azimuths[i - 1] + 360;
  }
  return {low, high};
}

}  // namespace

FieldOfView field_of_view(const ScanPattern& pattern) {
  FieldOfView fov{-180, 180, 90, -90};
  std::vector<double> azimuths;
  RayRange rays = pattern.fired_between(0, pattern.cycle_s());
  if (pattern.spins())
    rays.last = rays.first + pattern.group_size();  // one group of columns has all elevations
  for (std::int64_t i = rays.first; i < rays.last; ++i) {
    const Vec3 d = pattern.ray(i).direction;
    azimuths.push_back(deg(math::atan2(d.y, d.x)));
    const double elevation = deg(math::asin(d.z));
    fov.elevation_min_deg = std::min(fov.elevation_min_deg, elevation);
    fov.elevation_max_deg = std::max(fov.elevation_max_deg, elevation);
  }
  // The field of view of a spinning LiDAR includes the azimuths between its columns.
  if (!pattern.spins())
    std::tie(fov.azimuth_min_deg, fov.azimuth_max_deg) = azimuth_span(std::move(azimuths));
  return fov;
}

}  // namespace infrasim
