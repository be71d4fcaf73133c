#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "infrasim/core/geometry.h"
#include "infrasim/core/point_cloud.h"

namespace infrasim {

inline constexpr double kBoxMargin = 0.01;  ///< metres; tolerance for points on a face of a box

/// One return before it becomes a point.
struct Return {
  float dx, dy, dz;  ///< unit direction, levelled frame
  float range;       ///< range of the return, metres
  float hit_range;   ///< range of the hit without noise, metres
  /// whether the beam is wider than a ray, so that the hit may lie beside the line in this
  /// direction
  bool wide;
  bool second;      ///< whether the previous return is from the same ray
  float intensity;  ///< intensity of the return, 0 to 1
  float time;       ///< firing time since the start of the frame, seconds
  std::uint16_t ring;
  std::uint16_t class_id;
  std::int32_t object;  ///< index of the object in the frame; -1 for background
};

/// The two boxes of an object in the labels, in the levelled frame.
struct ObjectBoxes {
  Box3d frame;  ///< box at mid-frame
  Box3d scan;   ///< box at the mean time of the object's returns
};

/// Number of points on an object. Two points of one ray count once.
struct PointCount {
  int points = 0;
  int points_in_box = 0;
  int points_in_scan_box = 0;
};

/// Number of points on an object, and the extents of these points along the axes of the object's
/// box, in metres. Two points of one ray count once.
struct PointSpread {
  int points = 0;
  double along_m = 0;
  double across_m = 0;
  double up_m = 0;
};

/// Collects the returns of one LiDAR in one frame, in the order in which they are added.
class FrameBuilder {
 public:
  void start();
  /// Sets the time of the object positions that all following returns use, in seconds since the
  /// start of the frame. Without a value, each return uses the positions at its own firing time.
  void see_objects_at(std::optional<double> time_s) { frozen_s_ = time_s; }
  /// Reserves memory for `more` calls of `add`.
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
    scratch_.echo[size_] = r.second ? 1 : 0;
    rays_ += r.second ? 0 : 1;
    if (r.object >= 0) add_hit(r);
    ++size_;
  }
  std::size_t size() const { return size_; }
  /// Returns the coordinates x y z of the points that have been added so far, row-major.
  std::span<const float> xyz() const { return {scratch_.xyz.data(), 3 * size_}; }
  /// Keeps only the points with the given row numbers, which must be in increasing order.
  void keep(std::span<const int> rows);
  /// Returns all points with their attributes.
  PointCloud cloud() const;

  /// Returns the times of the returns of each object, in seconds since the start of the frame.
  std::vector<std::vector<double>> times_seen(std::size_t objects) const;

  /// A function that returns the box of an object in the levelled frame, at a time since the start
  /// of the frame.
  using BoxAt = std::function<Box3d(std::size_t object, double time_s)>;
  /// Counts the points of each object, in total and inside its boxes. A point can lie outside a box
  /// because the object moves. Range noise has no effect on the counts, because the positions
  /// without noise are used. The hit of a wide beam is moved onto the object. Points up to 1 cm
  /// outside a box count as inside.
  std::vector<PointCount> count(std::span<const ObjectBoxes> boxes, const BoxAt& box_at) const;

  /// Counts the points of each object, and measures their extent along the axes of its box at the
  /// time of each point. Range noise has no effect.
  std::vector<PointSpread> spread(std::size_t objects, const BoxAt& box_at) const;

 private:
  /// A return from an object, with its position.
  struct Hit {
    std::size_t row;
    std::size_t ray;  ///< number of the ray among those that gave a return
    std::int32_t object;
    double time_s;  ///< time of the object's state that the ray met
    bool wide;
    Vec3 place;

    /// Returns whether the previous hit is another echo of the same ray and object. Two such hits
    /// count once.
    bool again_after(const Hit* before) const {
      return before != nullptr && before->ray == ray && before->object == object;
    }
  };
  void add_hit(const Return& r);

  PointCloud scratch_;  // buffer that keeps its largest size between frames
  std::vector<Hit> hits_;
  std::optional<double> frozen_s_;
  std::size_t size_ = 0;
  std::size_t rays_ = 0;
};

}  // namespace infrasim
