#pragma once

#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>

#include "infrasim/core/math.h"

namespace infrasim {

inline constexpr double kPi = std::numbers::pi;
inline constexpr double kInf = std::numeric_limits<double>::infinity();

inline double rad(double degrees) { return degrees * (kPi / 180.0); }
inline double deg(double radians) { return radians * (180.0 / kPi); }

/// Wraps an angle into [-pi, pi).
inline double wrap_angle(double angle) {
  return angle - 2.0 * kPi * std::floor((angle + kPi) / (2.0 * kPi));
}

struct Vec2 {
  double x = 0;
  double y = 0;
};
inline Vec2 operator+(Vec2 a, Vec2 b) { return {a.x + b.x, a.y + b.y}; }
inline Vec2 operator-(Vec2 a, Vec2 b) { return {a.x - b.x, a.y - b.y}; }
inline Vec2 operator*(double s, Vec2 a) { return {s * a.x, s * a.y}; }
inline double dot(Vec2 a, Vec2 b) { return a.x * b.x + a.y * b.y; }
inline double cross(Vec2 a, Vec2 b) { return a.x * b.y - a.y * b.x; }
inline double norm(Vec2 a) { return math::hypot(a.x, a.y); }
/// Returns the unit vector in the direction of a heading.
inline Vec2 heading_vector(double heading) { return {math::cos(heading), math::sin(heading)}; }

struct Vec3 {
  double x = 0;
  double y = 0;
  double z = 0;
};
inline Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec3 operator*(double s, Vec3 a) { return {s * a.x, s * a.y, s * a.z}; }
inline double dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec3 cross(Vec3 a, Vec3 b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double norm(Vec3 a) { return std::sqrt(dot(a, a)); }

/// Rotation matrix, row-major.
using Mat3 = std::array<double, 9>;

inline Vec3 operator*(const Mat3& r, Vec3 v) {
  return {r[0] * v.x + r[1] * v.y + r[2] * v.z, r[3] * v.x + r[4] * v.y + r[5] * v.z,
          r[6] * v.x + r[7] * v.y + r[8] * v.z};
}
inline Mat3 operator*(const Mat3& a, const Mat3& b) {
  Mat3 c{};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k < 3; ++k) c[3 * i + j] += a[3 * i + k] * b[3 * k + j];
  return c;
}

/// Returns the rotation by yaw about z, then pitch about the new y, then roll about the new x
/// (radians). The y axis points left, so by the right-hand rule a positive pitch looks down.
inline Mat3 rotation(double yaw, double pitch, double roll) {
  const double cy = math::cos(yaw), sy = math::sin(yaw);
  const double cp = math::cos(pitch), sp = math::sin(pitch);
  const double cr = math::cos(roll), sr = math::sin(roll);
  return Mat3{cy, -sy, 0, sy, cy, 0, 0, 0, 1} * Mat3{cp, 0, sp, 0, 1, 0, -sp, 0, cp} *
         Mat3{1, 0, 0, 0, cr, -sr, 0, sr, cr};
}

/// Box of an object: geometric centre, length, width, height, yaw about +z, and then pitch about
/// the object's left axis as in `rotation` (positive looks down).
struct Box3d {
  double x = 0, y = 0, z = 0;
  double dx = 0, dy = 0, dz = 0;
  double heading = 0;
  double pitch = 0;

  bool operator==(const Box3d&) const = default;
};

/// Returns the smallest box without pitch and with the same heading that contains `box`.
Box3d levelled(const Box3d& box);

/// A box prepared for tests of many points.
class BoxFrame {
 public:
  explicit BoxFrame(const Box3d& box);
  /// Prepares `box`, and reuses the sines and cosines of `other` if heading and pitch are equal.
  BoxFrame(const Box3d& box, const BoxFrame& other)
      : BoxFrame(box.heading == other.box_.heading && box.pitch == other.box_.pitch
                     ? other
                     : BoxFrame(box)) {
    box_ = box;
  }

  /// Transforms a point from the frame in which the box is given to the box's own frame (to_box),
  /// or back (from_box).
  Vec3 to_box(Vec3 p) const;
  Vec3 from_box(Vec3 local) const;
  /// Returns whether the box contains a point; `margin` enlarges the box on all sides.
  bool contains(Vec3 p, double margin) const;
  /// Returns the point of the box that is nearest to p.
  Vec3 nearest(Vec3 p) const;

 private:
  Box3d box_;
  double cos_, sin_;  ///< cosine and sine of the heading
  /// cosine and sine of the pitch; exactly 1 and 0 for a level box, which avoids rounding errors
  double cos_pitch_, sin_pitch_;
};

/// Returns the corners of a box's footprint, counter-clockwise from the front right corner.
std::array<Vec2, 4> footprint(const Box3d& box);

/// Returns the area of an outline whose first corner is not repeated at its end; positive if the
/// corners are in counter-clockwise order.
double signed_area(std::span<const Vec2> outline);

/// Returns whether two convex counter-clockwise outlines overlap (touching does not count).
bool footprints_overlap(std::span<const Vec2> a, std::span<const Vec2> b);

/// Returns whether the point lies inside the convex counter-clockwise outline or on its edge.
bool covers(std::span<const Vec2> outline, Vec2 point);

/// Returns whether the point lies inside the outline, convex or not. It does if a ray from the
/// point towards +x crosses an odd number of edges.
bool encloses(std::span<const Vec2> outline, Vec2 point);

}  // namespace infrasim
