#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "infrasim/core/geometry.h"
#include "infrasim/core/point_cloud.h"

namespace infrasim {

/// One return before it becomes a point.
struct Return {
  float dx, dy, dz;  ///< unit direction, levelled frame
  float range;       ///< metres
  float intensity;   ///< [0, 1]
  float time;        ///< seconds since the start of the frame
  std::uint16_t ring;
  std::uint16_t class_id;
  std::int32_t object;  ///< index among the frame's objects; -1: background
};

/// How many points an object got.
struct PointCount {
  int points = 0;
  int points_in_box = 0;
};

/// Collects the returns of one LiDAR and frame, in the order they are added.
class FrameBuilder {
 public:
  void start() { size_ = 0; }
  /// Makes room for `more` calls of `add`.
  void reserve(std::size_t more);
  /// @param object_id id of the object, -1 for background
  void add(const Return& r, std::int32_t object_id) {
    scratch_.xyz[3 * size_] = r.dx * r.range;
    scratch_.xyz[3 * size_ + 1] = r.dy * r.range;
    scratch_.xyz[3 * size_ + 2] = r.dz * r.range;
    scratch_.intensity[size_] = r.intensity;
    scratch_.time[size_] = r.time;
    scratch_.ring[size_] = r.ring;
    scratch_.class_id[size_] = r.class_id;
    scratch_.object_id[size_] = object_id;
    object_[size_++] = r.object;
  }
  std::size_t size() const { return size_; }
  /// Row-major points so far.
  std::span<const float> xyz() const { return {scratch_.xyz.data(), 3 * size_}; }
  /// Drops all but the given rows, which must increase.
  void keep(std::span<const int> rows);
  /// The points, and per object index those it got. A point counts as inside the object's own box
  /// up to 1 cm outside of it.
  PointCloud take(const std::vector<Box3d>& boxes, std::vector<PointCount>& counts) const;

 private:
  PointCloud scratch_;  // kept at its largest size from frame to frame
  std::vector<std::int32_t> object_;
  std::size_t size_ = 0;
};

}  // namespace infrasim
