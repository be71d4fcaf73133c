#pragma once

#include <algorithm>
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
  std::vector<double> strength;    ///< of each echo, see `ReturnModel::strengths`

  std::size_t size() const { return ray.size(); }
  void resize(std::size_t n) {
    ray.resize(n);
    range.resize(n);
    intensity.resize(n);
  }
};

/// Decides which echoes become points. Range limits and drop-off are as in CARLA 0.9. Detection
/// depends on the ratio of the received power P = rho cos(theta) / R^2 exp(-2 alpha R) to the noise
/// of the RangeLaw. The extinction alpha comes from rain (Marshall-Palmer) and fog (Koschmieder).
/// Recorded surfaces have no additional losses.
class ReturnModel {
 public:
  ReturnModel(const ReturnsConfig& config, const WeatherConfig& weather);

  /// @param rng         stream of this unit and frame; ray i of the frame uses rng.at(i)
  /// @param first_ray   number within the frame of the ray from which `number` counts
  /// @param echoes      one per ray; reflectance and gain are read only if needs_reflectance()
  /// @param sunlit      reflectance of everything that the detector sees in this direction; for a
  ///   single ray it is that of its echo
  /// @param number      number of each ray of the batch; if empty, the rays are consecutive
  void apply(const Rng& rng, std::uint64_t first_ray, const EchoBatch& echoes,
             const std::vector<float>& sunlit, ReturnBatch& out,
             std::span<const std::uint32_t> number = {}) const;

  /// Returns whether a hit on the background can become a point. If not, no sample makes it one.
  /// @param gain of the Echo
  bool can_return(float range, float gain, std::uint16_t class_id) const;
  /// The range or, if it lies in the blind zone, the end of the blind zone.
  float nearest(float range) const {
    return std::max(range, static_cast<float>(config_.min_range_m));
  }

  bool needs_reflectance() const { return config_.detection.has_value(); }

  /// Attenuation by which the strongest echo of a ray is selected. For LiDARs that do not detect by
  /// received power, the air has no effect.
  EchoPath path() const {
    return {static_cast<float>(config_.min_range_m), config_.detection ? extinction_per_m_ : 0};
  }

 private:
  void strengths(const EchoBatch& echoes, const std::vector<float>& sunlit,
                 std::vector<double>& out) const;
  bool in_range(float range) const {
    return range >= static_cast<float>(config_.min_range_m) &&
           range <= static_cast<float>(config_.max_range_m);
  }
  bool is_recorded(const EchoBatch& echoes, std::size_t i) const;
  bool lost_at_random(const Rng& ray_rng) const;
  bool dropped_when_faint(const Rng& ray_rng, double intensity) const;

  ReturnsConfig config_;
  double extinction_per_m_ = 0;
  double signal_m2_ = 0;    ///< signal of a reflectance of 1 at 1 m
  double sun_per_rho_ = 0;  ///< squared ratio of the sunlight's noise to the detector's noise
};

/// Returns warnings, one line for each LiDAR with units on which the weather has no effect.
std::vector<std::string> weather_warnings(const WeatherConfig& weather,
                                          std::span<const LidarConfig> lidars);

}  // namespace infrasim
