#include <stdexcept>

#include "infrasim/core/math.h"
#include "infrasim/filter/filter.h"
#include "infrasim/filter/points.h"

namespace infrasim {

namespace {

void require(bool allowed, const char* message) {
  if (!allowed) throw std::invalid_argument(message);
}

}  // namespace

std::vector<int> keep(std::span<const float> xyz, const CropBox& box) {
  const auto& [x0, y0, z0] = box.min_m;
  const auto& [x1, y1, z1] = box.max_m;
  require(x0 <= x1 && y0 <= y1 && z0 <= z1, "crop_box: min must not be above max on any axis");
  return keep_if(xyz, [&](Vec3 p) {
    return p.x >= x0 && p.x <= x1 && p.y >= y0 && p.y <= y1 && p.z >= z0 && p.z <= z1;
  });
}

std::vector<int> keep(std::span<const float> xyz, const CropPolygon& polygon) {
  require(polygon.outline_m.size() >= 3 && std::abs(signed_area(polygon.outline_m)) > 0,
          "crop_polygon: at least 3 corners and an area are needed");
  return keep_if(xyz, [&](Vec3 p) { return encloses(polygon.outline_m, {p.x, p.y}); });
}

std::vector<int> keep(std::span<const float> xyz, const CropRange& range) {
  require(range.min_m >= 0 && range.min_m <= range.max_m, "crop_range: 0 <= min <= max is needed");
  return keep_if(xyz, [&](Vec3 p) { return norm(p) >= range.min_m && norm(p) <= range.max_m; });
}

std::vector<int> keep(std::span<const float> xyz, const CropFieldOfView& view) {
  const double from = view.azimuth_min_deg, to = view.azimuth_max_deg;
  require(std::abs(from) <= 180 && std::abs(to) <= 180,
          "crop_field_of_view: azimuths must lie in [-180, 180] degrees");
  require(view.elevation_min_deg <= view.elevation_max_deg,
          "crop_field_of_view: elevation min must not be above max");
  return keep_if(xyz, [&](Vec3 p) {
    const double elevation = deg(math::atan2(p.z, math::hypot(p.x, p.y)));
    if (elevation < view.elevation_min_deg || elevation > view.elevation_max_deg) return false;
    const double azimuth = deg(math::atan2(p.y, p.x));
    return from <= to ? azimuth >= from && azimuth <= to : azimuth >= from || azimuth <= to;
  });
}

}  // namespace infrasim
