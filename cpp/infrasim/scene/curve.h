#pragma once

#include <vector>

#include "infrasim/core/geometry.h"

namespace infrasim {

/// A point of a curve: position and direction of travel.
struct CurvePoint {
  Vec2 position;
  double heading = 0;
};

/// A plane curve given by samples. The station s is the length from the first sample. Position and
/// heading are linear between samples.
class Curve {
 public:
  Curve() = default;
  explicit Curve(std::vector<CurvePoint> samples);

  double length() const { return s_.back(); }
  const std::vector<CurvePoint>& samples() const { return samples_; }
  /// Station s of each sample.
  const std::vector<double>& stations() const { return s_; }
  /// Point at s, clamped to the curve's ends.
  CurvePoint at(double s) const;
  /// Station of the curve's point nearest to `point`.
  double project(Vec2 point) const;
  /// The part from s0 to s1.
  Curve part(double s0, double s1) const;
  /// Returns the curve with every sample moved to the left.
  Curve offset(double left_m) const;
  Curve reversed() const;
  /// Radius of the tightest bend; infinite for a straight curve.
  double tightest_radius() const;

 private:
  std::size_t segment_at(double s) const;

  std::vector<CurvePoint> samples_;
  std::vector<double> s_;
};

/// Smooth turn from one directed point to another (cubic Bezier, almost a circle for a right
/// angle).
Curve turn(const CurvePoint& from, const CurvePoint& to);

}  // namespace infrasim
