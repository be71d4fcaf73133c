#include "infrasim/core/point_cloud.h"

namespace infrasim {

void PointCloud::resize(std::size_t n) {
  xyz.resize(3 * n);
  intensity.resize(n);
  time.resize(n);
  ring.resize(n);
  class_id.resize(n);
  object_id.resize(n);
  echo.resize(n);
}

PointCloud PointCloud::select(std::span<const int> keep) const {
  PointCloud out;
  out.resize(keep.size());
  for (std::size_t i = 0; i < keep.size(); ++i) {
    const auto k = static_cast<std::size_t>(keep[i]);
    for (std::size_t axis = 0; axis < 3; ++axis) out.xyz[3 * i + axis] = xyz[3 * k + axis];
    out.intensity[i] = intensity[k];
    out.time[i] = time[k];
    out.ring[i] = ring[k];
    out.class_id[i] = class_id[k];
    out.object_id[i] = object_id[k];
    out.echo[i] = echo[k];
  }
  return out;
}

}  // namespace infrasim
