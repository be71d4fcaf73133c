#pragma once

#include "infrasim/config/lidar_config.h"

namespace infrasim {

/// The range of a LiDAR by reflectance and sunlight. By day the noise is sunlight that the target
/// reflects, so the range grows with the fourth root of the reflectance. In low light the
/// detector's own noise dominates, and the range grows with the square root.
struct RangeLaw {
  double dark_range_m;                     ///< of a 10 % target without sunlight
  double background_noise_crossover_klux;  ///< on a 10 % target: sunlight
                                           ///< noise equals detector noise

  /// Noise at `klux` of sunlight, in units of the detector's own noise.
  /// @param sunlit reflectance of the surface that the detector looks at
  double noise(double sunlit, double klux) const;

  /// Range at which signal and threshold are equal, at normal incidence and in clear air.
  double range_m(double reflectance, double klux) const;
};

/// Fits the law to the published ranges by squared errors of the logarithms of range. For this fit,
/// an error of 2 % by day weighs as much as 4 % at night. A range equal to the device's maximum is
/// only a lower limit for the law. Between equally good laws, the one with the crossover nearest to
/// 100 klx is taken; this is also the assumption for a LiDAR with one published range.
RangeLaw fit_range_law(const DetectionConfig& detection, double max_range_m);

/// A published range, and the range by the law.
struct LawRange {
  PublishedRange published;
  double law_m = 0;  ///< at most the device's maximum

  /// Relative error of the law; positive if its range is longer.
  double error() const { return law_m / published.range_m - 1; }
};

/// The published range with the largest relative error of the fitted law.
LawRange worst_of_law(const DetectionConfig& detection, double max_range_m);

}  // namespace infrasim
