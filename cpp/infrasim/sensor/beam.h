#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/core/geometry.h"
#include "infrasim/core/rays.h"

namespace infrasim {

/// A beam of elliptic cross-section with uniform intensity. It consists of a middle sub-ray and
/// rings of sub-rays around the middle. Each sub-ray stands for a part of the ellipse: the middle
/// sub-ray for an inner ellipse, each other sub-ray for a part of a ring. All parts are about
/// equally large.
class Beam {
 public:
  /// @param config    without a value, the beam is one ray
  /// @param unit_pose rotation from the unit's frame to the levelled frame
  Beam(const std::optional<BeamConfig>& config, const Mat3& unit_pose);

  std::size_t sub_rays() const { return places_.size(); }
  /// Returns the number of probes, which are the first sub-rays of a beam. If all probes meet the
  /// same surface, the other sub-rays are not cast.
  std::size_t probes() const { return probe_shares_.size(); }

  /// Returns the share of the beam's power in each sub-ray; the sum of the shares is 1.
  std::span<const float> shares() const { return shares_; }
  /// Returns the share of the beam's power in each probe if only the probes are cast; the sum of
  /// the shares is 1.
  std::span<const float> probe_shares() const { return probe_shares_; }

  /// Returns the tangent of the angle between a ray and its outermost sub-rays.
  float half_width() const { return half_width_; }

  /// Returns the range, in metres, beyond which the outermost sub-rays are at least 2 cm away from
  /// the middle ray. For bodies at shorter ranges, one ray is cast instead of the beam.
  float from_m() const { return from_m_; }

  /// Returns whether all rays have sub-rays. Otherwise, only rays near moving objects have them.
  bool everywhere() const { return everywhere_; }

  /// Appends sub-rays `from` to `to` - 1 of the selected rays, ray by ray. Sub-ray 0 is the ray
  /// itself.
  void expand(const RayBatch& rays, std::span<const std::uint32_t> selected, std::size_t from,
              std::size_t to, RayBatch& sub_rays) const;

 private:
  std::array<Vec3, 2> axes_of(Vec3 ray) const;

  /// offsets of the sub-rays from the ray to the left and upwards, as tangents of angles
  std::vector<Vec2> places_;
  std::vector<float> shares_;
  std::vector<float> probe_shares_;
  float half_width_ = 0;
  float from_m_ = 0;
  bool everywhere_ = false;
  Vec3 up_, left_;  ///< axes of the unit in the levelled frame
};

}  // namespace infrasim
