#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "infrasim/sensor/echo_path.h"
#include "infrasim/sensor/echoes.h"

namespace infrasim {

/// An echo of a ray, besides its strongest one.
struct WeakerEcho {
  std::uint32_t ray;
  Echo echo;
};

/// A sub-ray of a beam.
struct SubRay {
  std::uint32_t beam;  ///< index among the beams
  float share;         ///< share of the beam's power
};

/// Merges the echoes of the sub-rays of beams. Echoes within a separation of each other are summed.
/// The range of the sum is the power-weighted mean. Its reflectance is that of a full beam with the
/// same power and a gain of 1.
class EchoMerger {
 public:
  /// @param separation_m minimum distance between two echoes of a beam
  EchoMerger(double separation_m, const EchoPath& path)
      : separation_m_(static_cast<float>(separation_m)), path_(path) {}

  /// Stores the strongest sum of each beam beyond the blind zone as the echo of its ray.
  /// @param sub_rays   the sub-rays of all beams, in any order
  /// @param sub_echoes strongest echo of each sub-ray
  /// @param weaker     other echoes of the sub-rays
  /// @param beams      index of each beam's ray
  /// @param rings      ring of each ray
  /// @param echoes     one per ray; those of other rays do not change
  /// @param sunlit     one per ray: reflectance of everything that the beam hits, for the sunlight
  ///   that it reflects
  /// @param others     if not null, gets the other sums of each beam, the strongest first
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
    std::size_t around = 0;  ///< index of the part in the middle of the sum
  };
  Sum strongest_sum(std::uint16_t ring) const;
  Sum sum_around(std::size_t a) const;

  float separation_m_;
  EchoPath path_;
  std::vector<PartialEcho> parts_;  ///< partial echoes of one beam
};

}  // namespace infrasim
