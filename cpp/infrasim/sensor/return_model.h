#pragma once

#include <span>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/config/scene_config.h"
#include "infrasim/core/rng.h"
#include "infrasim/sensor/echo_path.h"
#include "infrasim/sensor/echoes.h"

namespace infrasim {

/// Echoes that became points, in the order of their rays.
struct ReturnBatch {
  std::vector<std::uint32_t> ray;  ///< index in the batch of rays
  std::vector<float> range;        ///< metres, with noise
  std::vector<float> intensity;    ///< [0, 1]

  std::size_t size() const { return ray.size(); }
  void resize(std::size_t n) {
    ray.resize(n);
    range.resize(n);
    intensity.resize(n);
  }
};

/// Which echoes become points. Range limits and drop-off as in CARLA 0.9; detection by received
/// power P = rho cos(theta) / R^2 exp(-2 alpha R) over the noise of the RangeLaw, with extinction
/// alpha by rain (Marshall-Palmer) and fog (Koschmieder). What a recording saw is not lost again.
class ReturnModel {
 public:
  ReturnModel(const ReturnsConfig& config, const WeatherConfig& weather);

  /// @param rng         stream of this unit and frame; ray i of the frame draws from rng.at(i)
  /// @param first_ray   number of the batch's first ray within the frame
  /// @param echoes      one per ray; reflectance and gain are read only if needs_reflectance()
  /// @param sunlit      reflectance of all that the detector receives light from there, which for a
  ///                    single ray is that of its echo
  void apply(const Rng& rng, std::uint64_t first_ray, const EchoBatch& echoes,
             const std::vector<float>& sunlit, ReturnBatch& out) const;

  bool needs_reflectance() const { return config_.detection.has_value(); }

  /// By which the strongest echo of a ray is told: the air takes nothing from LiDARs that do not
  /// detect by received power.
  EchoPath path() const {
    return {static_cast<float>(config_.min_range_m), config_.detection ? extinction_per_m_ : 0};
  }

 private:
  bool is_recorded(const EchoBatch& echoes, std::size_t i) const;
  bool lost_at_random(const Rng& draw) const;
  bool dropped_when_faint(const Rng& draw, double intensity) const;
  double snr(double range, double reflected, double sunlit) const;

  ReturnsConfig config_;
  double extinction_per_m_ = 0;
  double signal_m2_ = 0;    ///< of a reflectance of 1, at 1 m
  double sun_per_rho_ = 0;  ///< square of the sun's noise over that of the detector
};

/// One line for each LiDAR that the weather does not touch, wholly or on some of its units: what a
/// user should know before the run.
std::vector<std::string> weather_warnings(const WeatherConfig& weather,
                                          std::span<const LidarConfig> lidars);

}  // namespace infrasim
