#pragma once

#include "infrasim/config/lidar_config.h"

namespace infrasim {

/// Returns the detector's noise in sunlight, relative to its noise in the dark.
/// @param sun sunlight that the detector sees, relative to the crossover of its RangeLaw
double noise_in_sun(double sun, double day_exponent);

/// The range of a LiDAR as a function of reflectance and sunlight. In low light the noise of the
/// detector dominates, and the range grows with the square root of the reflectance. Above the
/// crossover, the noise grows with the power 1 - 2 day_exponent of the sunlight that the target
/// reflects, so the range grows with the power day_exponent of the reflectance. With an exponent of
/// 1/4, the noise is shot noise of the sunlight. With 1/2, sunlight adds no noise. Values between
/// them describe receivers that sunlight disturbs less.
struct RangeLaw {
  double dark_range_m;                     ///< range of a 10 % target without sunlight
  double background_noise_crossover_klux;  ///< sunlight on a 10 % target at which the noise of the
                                           ///< background light equals the detector's noise
  double day_exponent = kLawExponent;

  /// Returns the noise at `klux` of sunlight, relative to the detector's noise in the dark.
  /// @param sunlit reflectance of the surface in the detector's field of view
  double noise(double sunlit, double klux) const;

  /// Returns the range at which the signal equals the detection threshold, at normal incidence and
  /// in clear air.
  double range_m(double reflectance, double klux) const;
};

/// Fits the law to the published ranges by least squares of the logarithm of the range. In the fit,
/// an error of 2 % by day has the same weight as an error of 4 % at night. A published range that
/// equals the LiDAR's maximum range is only a lower limit. Of equally good laws, the fit selects
/// the law with the crossover nearest to 100 klx, and then the law with the smallest exponent. For
/// a LiDAR with one published range, the crossover is therefore 100 klx, and the exponent is
/// `law_exponent`.
RangeLaw fit_range_law(const DetectionConfig& detection, double max_range_m);

/// A published range, and the range that the law predicts.
struct LawRange {
  PublishedRange published;
  double law_m = 0;  ///< range that the law predicts, at most the LiDAR's maximum range

  /// Returns the relative error of the law; positive if the law's range is longer than the
  /// published range.
  double error() const { return law_m / published.range_m - 1; }
};

/// Returns the published range for which the fitted law has the largest relative error.
LawRange worst_of_law(const DetectionConfig& detection, double max_range_m);

}  // namespace infrasim
