#pragma once

#include "infrasim/config/lidar_config.h"

namespace infrasim {

/// How far a LiDAR sees: by day the noise is sunlight that the target itself reflects, so that
/// range goes with the fourth root of reflectance; below some light the detector's own noise rules,
/// and it goes with the square root.
struct RangeLaw {
  double dark_range_m;                     ///< of a 10 % target without sunlight
  double background_noise_crossover_klux;  ///< on a 10 % target, where sunlight is as loud as the
                                           ///< detector

  /// Of the noise in `klux`, in units of the detector's own.
  /// @param sunlit reflectance of what the detector looks at
  double noise(double sunlit, double klux) const;

  /// Where signal and threshold are equal, head on and in clear air.
  double range_m(double reflectance, double klux) const;
};

/// The law nearest to what the vendor publishes: squared errors of the logarithms of range, where
/// 2 % by day weigh as 4 % at night. A range that is the device's last is one that the law must
/// reach. Of equal laws the one whose balance is nearest to 100 klx, which is the assumption for a
/// LiDAR with one range.
RangeLaw fit_range_law(const DetectionConfig& detection, double max_range_m);

/// A published range, and where the law puts it.
struct LawRange {
  PublishedRange published;
  double law_m = 0;  ///< at most the device's last

  /// Share by which the law is farther.
  double error() const { return law_m / published.range_m - 1; }
};

/// The published range that the nearest law misses by the largest share.
LawRange worst_of_law(const DetectionConfig& detection, double max_range_m);

}  // namespace infrasim
