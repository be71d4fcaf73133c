#pragma once

#include <span>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/core/geometry.h"
#include "infrasim/core/rays.h"
#include "infrasim/sensor/echo_path.h"
#include "infrasim/sensor/echoes.h"

namespace infrasim {

/// A beam that is wider than a ray. It consists of sub-rays side by side along the beam's longer
/// axis, which is vertical or horizontal in the unit's frame. Sub-rays are offset perpendicular to
/// the ray.
class Beam {
 public:
  /// @param unit_pose rotation from the unit's frame to the levelled frame
  Beam(const BeamConfig& config, const Mat3& unit_pose);

  int sub_rays() const { return static_cast<int>(offsets_.size()); }

  /// Tangent of the angle between a ray and its outermost sub-rays.
  float half_width() const { return offsets_.back(); }

  /// Makes the sub-rays of the selected rays. The middle sub-ray is the ray itself.
  void expand(const RayBatch& rays, std::span<const std::uint32_t> selected,
              RayBatch& sub_rays) const;

  /// Merges the echoes of the sub-rays into one echo per selected ray, and stores it at the ray's
  /// index. The other rays get no echo. Echoes within the range resolution of each other are
  /// summed, and the strongest sum beyond the blind zone becomes the echo. Its range is the
  /// power-weighted mean. Its reflectance is that of a full beam with the same power and a gain
  /// of 1.
  /// @param sub_echoes one per sub-ray
  /// @param echoes     one per ray
  /// @param sunlit     reflectance of everything that the beam hits, for the sunlight that it
  ///   reflects
  void combine(const EchoBatch& sub_echoes, std::span<const std::uint32_t> selected,
               const EchoPath& path, EchoBatch& echoes, std::vector<float>& sunlit) const;

 private:
  struct MergedEcho {
    float power = 0, weighted_range = 0, reflected = 0;
    std::size_t strongest = 0;  ///< index of its strongest sub-ray
    bool holds_all = false;     ///< whether it contains every sub-ray with a hit
  };

  Vec3 side_of(Vec3 ray) const;
  MergedEcho echo_around(std::size_t a, std::size_t first, const EchoBatch& sub_echoes) const;

  std::vector<float> offsets_;  ///< sideways offsets as tangents
  bool vertical_;
  Vec3 up_, left_;  ///< axes of the unit in the levelled frame
};

}  // namespace infrasim
