#include "infrasim/pipeline/frame_builder.h"

#include <algorithm>
#include <cmath>

namespace infrasim {

namespace {

constexpr double kBoxMargin = 0.01;  // m: points on a face stay inside whatever the rounding

bool inside(const Box3d& box, double cos_heading, double sin_heading, const float* p) {
  const double x = p[0] - box.x, y = p[1] - box.y, z = p[2] - box.z;
  return std::abs(cos_heading * x + sin_heading * y) <= box.dx / 2 + kBoxMargin &&
         std::abs(-sin_heading * x + cos_heading * y) <= box.dy / 2 + kBoxMargin &&
         std::abs(z) <= box.dz / 2 + kBoxMargin;
}

template <class T>
void copy_head(const std::vector<T>& from, std::vector<T>& to, std::size_t n) {
  to.assign(from.begin(), from.begin() + static_cast<std::ptrdiff_t>(n));
}

}  // namespace

void FrameBuilder::reserve(std::size_t more) {
  if (size_ + more <= object_.size()) return;
  const std::size_t grown = std::max<std::size_t>(4096, 2 * (size_ + more));
  scratch_.resize(grown);
  object_.resize(grown);
}

void FrameBuilder::keep(std::span<const int> rows) {
  size_ = 0;
  for (const int row : rows) {
    const auto from = static_cast<std::size_t>(row);
    std::copy_n(&scratch_.xyz[3 * from], 3, &scratch_.xyz[3 * size_]);
    scratch_.intensity[size_] = scratch_.intensity[from];
    scratch_.time[size_] = scratch_.time[from];
    scratch_.ring[size_] = scratch_.ring[from];
    scratch_.class_id[size_] = scratch_.class_id[from];
    scratch_.object_id[size_] = scratch_.object_id[from];
    object_[size_++] = object_[from];
  }
}

PointCloud FrameBuilder::take(const std::vector<Box3d>& boxes,
                              std::vector<PointCount>& counts) const {
  std::vector<std::pair<double, double>> turns;
  for (const Box3d& box : boxes) turns.emplace_back(std::cos(box.heading), std::sin(box.heading));
  counts.assign(boxes.size(), {});
  for (std::size_t i = 0; i < size_; ++i) {
    if (object_[i] < 0) continue;
    const auto k = static_cast<std::size_t>(object_[i]);
    ++counts[k].points;
    counts[k].points_in_box +=
        inside(boxes[k], turns[k].first, turns[k].second, &scratch_.xyz[3 * i]);
  }
  PointCloud cloud;
  copy_head(scratch_.xyz, cloud.xyz, 3 * size_);
  copy_head(scratch_.intensity, cloud.intensity, size_);
  copy_head(scratch_.time, cloud.time, size_);
  copy_head(scratch_.ring, cloud.ring, size_);
  copy_head(scratch_.class_id, cloud.class_id, size_);
  copy_head(scratch_.object_id, cloud.object_id, size_);
  return cloud;
}

}  // namespace infrasim
