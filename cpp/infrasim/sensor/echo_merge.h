#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "infrasim/sensor/echo_path.h"
#include "infrasim/sensor/echoes.h"

namespace infrasim {

/// An echo that is not the strongest echo of its ray.
struct WeakerEcho {
  std::uint32_t ray;
  Echo echo;
};

struct SubRay {
  std::uint32_t beam;  ///< index of the beam
  float share;         ///< share of the beam's power
};

/// Merges the echoes of the sub-rays of a beam. Echoes that are closer together than `separation_m`
/// are summed. The range of a sum is the mean of the ranges of its echoes, weighted by power. The
/// reflectance of a sum is the reflectance of a surface that fills the beam, has a gain of 1, and
/// returns the same power.
class EchoMerger {
 public:
  /// @param separation_m minimum distance between two echoes of a beam
  EchoMerger(double separation_m, const EchoPath& path)
      : separation_m_(static_cast<float>(separation_m)), path_(path) {}

  /// Stores the strongest sum of echoes of each beam as the echo of the beam's ray. Only sums
  /// beyond the blind zone count.
  /// @param sub_rays   the sub-rays of all beams, in any order
  /// @param sub_echoes strongest echo of each sub-ray
  /// @param weaker     echoes of the sub-rays that are not the strongest echo of their sub-ray
  /// @param beams      index of each beam's ray
  /// @param rings      ring of each ray
  /// @param echoes     echo of each ray; echoes of rays without a beam do not change
  /// @param sunlit     for each ray, the mean reflectance of everything that its beam hits, which
  ///   determines the reflected sunlight
  /// @param others     if not null, gets the sums of each beam except its strongest sum, in
  ///   descending order of power
  void merge(std::span<const SubRay> sub_rays, const EchoBatch& sub_echoes,
             std::span<const WeakerEcho> weaker, std::span<const std::uint32_t> beams,
             std::span<const std::uint16_t> rings, EchoBatch& echoes, std::vector<float>& sunlit,
             std::vector<WeakerEcho>* others);

 private:
  /// A part of the beam's power that comes back from one surface.
  struct PartialEcho {
    float range;
    float reflected;  ///< share of the beam's power, times reflectance and gain
    std::int32_t object;
    std::uint16_t class_id;
  };
  struct Sum {
    Echo echo;
    float received = 0;      ///< power after extinction; 0 in the blind zone
    std::size_t around = 0;  ///< index in `parts_` of the partial echo in the middle of the sum
  };
  Sum strongest_sum(std::uint16_t ring) const;
  Sum sum_around(std::size_t a) const;

  float separation_m_;
  EchoPath path_;
  std::vector<PartialEcho> parts_;  ///< partial echoes of one beam
};

}  // namespace infrasim
