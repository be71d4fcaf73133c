#pragma once

#include <span>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/core/geometry.h"
#include "infrasim/core/rays.h"
#include "infrasim/sensor/echo_path.h"
#include "infrasim/sensor/echoes.h"

namespace infrasim {

/// A beam wider than a ray, as sub-rays side by side along its longer axis: up and down, or level,
/// as the unit stands. All are across the ray.
class Beam {
 public:
  /// @param unit_pose rotation from the unit's frame to the levelled frame
  Beam(const BeamConfig& config, const Mat3& unit_pose);

  int sub_rays() const { return static_cast<int>(offsets_.size()); }

  /// Tangent of the angle between a ray and its outermost sub-rays.
  float half_width() const { return offsets_.back(); }

  /// Sub-rays of the selected rays, side by side; the middle of them is the ray itself.
  void expand(const RayBatch& rays, std::span<const std::uint32_t> selected,
              RayBatch& sub_rays) const;

  /// One echo per selected ray, in its place among `echoes`; the other rays have none. Of its
  /// sub-rays' echoes, those within the range resolution of each other add up, and the strongest
  /// sum beyond the blind zone is reported. Its range is the power-weighted mean, its reflectance
  /// that of a full beam of the same power, at a gain of 1.
  /// @param sub_echoes of each sub-ray
  /// @param echoes     as many as rays
  /// @param sunlit     reflectance of all that the beam hits, as the sun lights it
  void combine(const EchoBatch& sub_echoes, std::span<const std::uint32_t> selected,
               const EchoPath& path, EchoBatch& echoes, std::vector<float>& sunlit) const;

 private:
  struct MergedEcho {
    float power = 0, weighted_range = 0, reflected = 0;
    std::size_t strongest = 0;  ///< of its sub-rays
    bool holds_all = false;     ///< every sub-ray that hit anything is in it
  };

  Vec3 side_of(Vec3 ray) const;
  MergedEcho echo_around(std::size_t a, std::size_t first, const EchoBatch& sub_echoes) const;

  std::vector<float> offsets_;  ///< tangents, to the side
  bool vertical_;
  Vec3 up_, left_;  ///< of the unit, levelled frame
};

}  // namespace infrasim
