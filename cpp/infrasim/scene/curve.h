#pragma once

#include <optional>
#include <vector>

#include "infrasim/core/geometry.h"
#include "infrasim/scene/outline_index.h"

namespace infrasim {

/// A point of a curve: position and direction of travel.
struct CurvePoint {
  Vec2 position;
  double heading = 0;
};

/// A plane curve given by samples. The station s is the length along the curve from the first
/// sample. Position and heading are linear between samples.
class Curve {
 public:
  Curve() = default;
  explicit Curve(std::vector<CurvePoint> samples);

  double length() const { return s_.back(); }
  const std::vector<CurvePoint>& samples() const { return samples_; }
  /// Returns the station s of each sample.
  const std::vector<double>& stations() const { return s_; }
  /// Returns the point at the station s, or the nearer end if s is outside the curve.
  CurvePoint at(double s) const;
  /// Returns the station of the curve's point nearest to `point`.
  double project(Vec2 point) const;
  /// A point of a segment.
  struct SegmentPoint {
    double away;     ///< distance from the given point
    double station;  ///< station on the curve
  };
  /// Returns the point of a segment that is nearest to `point`.
  /// @param segment index of the segment's first sample
  SegmentPoint nearest_on(std::size_t segment, Vec2 point) const;
  /// Returns the part of the curve between the stations s0 and s1.
  Curve part(double s0, double s1) const;
  /// Returns the curve with every sample moved to its left by `left_m`.
  Curve offset(double left_m) const;
  Curve reversed() const;
  /// Returns the radius of the tightest bend; infinite for a straight curve.
  double tightest_radius() const;

 private:
  std::size_t segment_at(double s) const;

  std::vector<CurvePoint> samples_;
  std::vector<double> s_;
};

/// Projects points onto a curve without a search over the whole curve. A grid lists the segments in
/// a rectangle.
class CurveGrid {
 public:
  /// @param low, high  corners of the rectangle that contains the points to project
  /// @param reach_m    maximum distance of the curve from a point
  CurveGrid(const Curve& curve, Vec2 low, Vec2 high, double reach_m);

  /// Returns the same station as Curve::project if the curve is within `reach_m` of the point.
  /// Otherwise it returns no value.
  /// @param curve the curve of the constructor, or a copy of it
  std::optional<double> project(const Curve& curve, Vec2 point) const;

 private:
  Vec2 low_, high_;
  double reach_m_;
  OutlineIndex segments_;
};

/// Returns a smooth turn from one directed point to another (cubic Bezier, almost a circle for a
/// right angle).
Curve turn(const CurvePoint& from, const CurvePoint& to);

}  // namespace infrasim
