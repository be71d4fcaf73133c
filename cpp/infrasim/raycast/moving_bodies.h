#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <span>
#include <tuple>
#include <utility>
#include <vector>

#include "infrasim/core/geometry.h"
#include "infrasim/core/math.h"
#include "infrasim/raycast/view_bounds.h"

namespace infrasim {

/// A body of the mesh library, which is scaled to its box and moves during one frame. Position and
/// pitch are linear in time. The heading changes linearly in the direction of the smaller turn.
/// Boxes are in the levelled frame.
struct MovingBody {
  int body = 0;
  Box3d from;
  Box3d to;
};

/// Returns the box of a moving body at the time `share`, which is a share of the frame's duration.
Box3d box_at(const MovingBody& body, double share);

/// Transforms rays that start at the origin into the unit box of a moving body, each ray at its own
/// firing time. Ranges along a ray do not change.
class BodyMotion {
 public:
  explicit BodyMotion(const MovingBody& body);

  struct UnitRay {
    float x, y, z;     ///< origin of the ray
    float dx, dy, dz;  ///< direction, not of unit length
    std::array<float, 3> at(float range) const {
      return {x + range * dx, y + range * dy, z + range * dz};
    }
  };
  /// @param share time at which the ray is fired, as a share of the frame, [0, 1]
  UnitRay to_unit(float dx, float dy, float dz, float share) const {
    float c = cos_, s = sin_;
    if (turn_ != 0) std::tie(c, s) = turned(share);
    const float px = x_ + share * travel_x_, py = y_ + share * travel_y_;
    if (pitch_ != 0 || pitch_turn_ != 0) {
      const float cp = math::cos(pitch_ + share * pitch_turn_);
      const float sp = math::sin(pitch_ + share * pitch_turn_);
      const float ahead = c * px + s * py, up = z_ + share * travel_z_, forth = c * dx + s * dy;
      return {-(cp * ahead - sp * up) * inv_dx_, (s * px - c * py) * inv_dy_,
              -(sp * ahead + cp * up) * inv_dz_, (cp * forth - sp * dz) * inv_dx_,
              (c * dy - s * dx) * inv_dy_,       (sp * forth + cp * dz) * inv_dz_};
    }
    return {-(c * px + s * py) * inv_dx_,        (s * px - c * py) * inv_dy_,
            -(z_ + share * travel_z_) * inv_dz_, (c * dx + s * dy) * inv_dx_,
            (c * dy - s * dx) * inv_dy_,         dz * inv_dz_};
  }

  /// Converts a length in metres to lengths along the axes of the unit box.
  std::array<float, 3> to_unit_lengths(float length_m) const {
    return {length_m * inv_dx_, length_m * inv_dy_, length_m * inv_dz_};
  }

  /// Converts a normal in the frame of the unit box to a unit normal in the frame of the body. The
  /// given normal may have any length.
  std::array<float, 3> normal(float nx, float ny, float nz) const {
    nx *= inv_dx_, ny *= inv_dy_, nz *= inv_dz_;
    const float length = std::sqrt(nx * nx + ny * ny + nz * nz);
    return length > 0 ? std::array{nx / length, ny / length, nz / length}
                      : std::array{0.F, 0.F, 1.F};
  }

  /// Returns the cosine of the angle of incidence of a ray on a surface of the body. The ray and
  /// the surface's normal are given in the frame of the unit box. The normal may have any length.
  float cos_incidence(const UnitRay& ray, float nx, float ny, float nz) const {
    const float ahead = std::abs(nx * ray.dx + ny * ray.dy + nz * ray.dz);
    nx *= inv_dx_, ny *= inv_dy_, nz *= inv_dz_;
    const float length = std::sqrt(nx * nx + ny * ny + nz * nz);
    return length > 0 ? std::min(1.0F, ahead / length) : 0.0F;
  }

 private:
  /// Returns the cosine and sine of the heading at the time `share`, which is a share of the
  /// frame's duration. Most turns are so small that a short series has the precision of float.
  std::pair<float, float> turned(float share) const {
    const float a = share * turn_, q = a * a;
    if (q > kSmallTurn * kSmallTurn) return {math::cos(heading_ + a), math::sin(heading_ + a)};
    const float c = 1 - q / 2 * (1 - q / 12 * (1 - q / 30)), s = a * (1 - q / 6 * (1 - q / 20));
    return {cos_ * c - sin_ * s, sin_ * c + cos_ * s};
  }

  /// maximum turn for the series, in radians; the error is below 3e-9
  static constexpr float kSmallTurn = 0.2F;
  float x_, y_, z_, travel_x_, travel_y_, travel_z_;
  float heading_, turn_, cos_, sin_;
  float pitch_, pitch_turn_;  ///< positive if the front of the body points down
  float inv_dx_, inv_dy_, inv_dz_;
};

/// Finds the bodies that rays of a view can meet at any time of the frame. A view is a rectangle of
/// directions.
class BodyIndex {
 public:
  BodyIndex() { set(std::span<const MovingBody>{}); }
  void set(std::span<const MovingBody> bodies);
  /// Fills the index with objects of any kind, given by their views.
  void set(std::vector<std::array<ViewBounds, 2>> views);

  /// Calls `visit` with the index of each body that the view may meet, in increasing order, until
  /// `visit` returns false. Every body that a ray of the view hits is visited.
  template <class Visit>
  void for_each_in(const ViewBounds& view, const Visit& visit) const {
    if (bounds_.empty() || view.left > view.right) return;
    const std::size_t first = bin(view.left), last = bin(view.right);
    for (std::size_t w = 0; w < words_; ++w) {
      std::uint64_t near = 0;
      for (std::size_t b = first; b <= last; ++b) near |= bins_[b * words_ + w];
      for (; near != 0; near &= near - 1) {
        const std::size_t i = 64 * w + static_cast<std::size_t>(std::countr_zero(near));
        if (meets(i, view) && !visit(i)) return;
      }
    }
  }
  /// Returns the view of each body. A body across the azimuth of 180 degrees has a view of two
  /// parts.
  std::span<const std::array<ViewBounds, 2>> views() const { return bounds_; }

  bool any_in(const ViewBounds& view) const {
    bool any = false;
    for_each_in(view, [&](std::size_t) { return !(any = true); });
    return any;
  }

 private:
  static constexpr std::size_t kBins = 128;  // number of bearing bins
  static std::size_t bin(float bearing) { return bearing_bin(bearing, kBins); }
  bool meets(std::size_t i, const ViewBounds& view) const {
    return bounds_[i][0].meets(view) || bounds_[i][1].meets(view);
  }

  std::vector<std::array<ViewBounds, 2>> bounds_;
  std::size_t words_ = 0;
  /// for each bin, one bit per body, set if the body's view overlaps the bin
  std::vector<std::uint64_t> bins_;
};

}  // namespace infrasim
