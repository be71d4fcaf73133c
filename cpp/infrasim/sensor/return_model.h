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

/// Maximum number of echoes of a ray that can become points.
inline constexpr std::size_t kMostEchoes = 8;

/// Echoes that became points, in the order of the echoes.
struct ReturnBatch {
  std::vector<std::uint32_t> echo;  ///< index of the echo in the batch of echoes
  std::vector<float> range;         ///< range in metres, with noise
  std::vector<float> intensity;     ///< intensity, 0 to 1
  /// strength of each echo of the batch, see `ReturnModel::strengths`
  std::vector<double> strength;

  std::size_t size() const { return echo.size(); }
  void resize(std::size_t n) {
    echo.resize(n);
    range.resize(n);
    intensity.resize(n);
  }
};

/// Decides which echoes become points. Range limits and drop-off are as in CARLA 0.9. Detection
/// depends on the ratio of the received power P = rho cos(theta) exp(-2 alpha R) / R^2 to the noise
/// of the RangeLaw. R is the range, rho the reflectance, and theta the angle of incidence. The
/// extinction alpha comes from rain (Marshall-Palmer) and fog (Koschmieder). Recorded surfaces have
/// no additional losses.
class ReturnModel {
 public:
  /// @param channels    channels of a spinning unit from the lowest ring up; their ranges replace
  ///   those of `config` if the unit detects by received power. The span is empty for other units.
  /// @param first_ring  ring number of the unit's lowest laser
  ReturnModel(const ReturnsConfig& config, const WeatherConfig& weather,
              std::span<const Channel> channels = {}, int first_ring = 0);

  /// Sets `out` to the echoes that become points.
  /// @param rng         random stream of this unit and frame; ray i of the frame uses rng.at(i)
  /// @param first_ray   index, within the frame, of the ray whose `number` is 0
  /// @param echoes      reflectance and gain are read only if needs_reflectance()
  /// @param sunlit      mean reflectance of all surfaces that the detector sees in the direction of
  ///   each echo; for a single ray, the reflectance of its echo
  /// @param rings       ring of each echo; read only if has_channels()
  /// @param number      number of the ray of each echo; if empty, each ray has one echo
  /// @param rank        index of each echo among the echoes of its ray, 0 to kMostEchoes - 1; if
  ///   empty, each echo is the first of its ray
  void apply(const Rng& rng, std::uint64_t first_ray, const EchoBatch& echoes,
             const std::vector<float>& sunlit, std::span<const std::uint16_t> rings,
             ReturnBatch& out, std::span<const std::uint32_t> number = {},
             std::span<const std::uint8_t> rank = {}) const;

  /// Returns, for each echo of the background, whether any random sample can make the echo a point.
  std::vector<bool> can_return(const EchoBatch& echoes, std::span<const std::uint16_t> rings) const;
  /// Returns the range or, if the range lies in the blind zone of the ring, the end of the blind
  /// zone.
  float nearest(float range, std::uint16_t ring) const {
    return std::max(range, limits_of(ring).min_range_m);
  }

  /// Returns whether any channel has its own range on a 10 % target or its own minimum range.
  bool has_channels() const { return !by_ring_.empty(); }

  /// Returns whether rays are lost at random.
  bool loses_rays() const { return config_.drop_off.has_value(); }
  /// Returns whether a ray is lost at random, unless it meets a recorded surface.
  bool loses(const Rng& ray_rng) const { return lost_at_random(ray_rng, 0); }

  bool needs_reflectance() const { return config_.detection.has_value(); }

  EchoMode echo_mode() const { return echoes_.mode; }
  double separation_m() const { return echoes_.separation_m; }

  /// Returns the attenuation that is used to select the strongest echo of a ray. For LiDARs that do
  /// not detect by received power, the air has no effect. The EchoPath refers to data of the model,
  /// so the model must outlive it.
  EchoPath path() const {
    return {.min_range_m = limits_.min_range_m,
            .extinction_per_m = config_.detection ? extinction_per_m_ : 0,
            .min_range_by_ring_m = min_range_by_ring_m_,
            .first_ring = first_ring_};
  }

 private:
  void strengths(const EchoBatch& echoes, const std::vector<float>& sunlit,
                 std::span<const std::uint16_t> rings, std::vector<double>& out) const;
  bool is_recorded(const EchoBatch& echoes, std::size_t i) const;
  bool lost_at_random(const Rng& ray_rng, unsigned first_sample) const;
  bool dropped_when_faint(const Rng& ray_rng, unsigned first_sample, double intensity) const;

  ReturnsConfig config_;
  EchoesConfig echoes_;
  double extinction_per_m_ = 0;
  /// Properties that may differ between the channels of a LiDAR unit.
  struct ChannelLimits {
    /// signal of a target of reflectance 1 at 1 m, relative to the detection threshold in the dark
    double signal_m2 = 0;
    float min_range_m = 0;
  };
  bool in_range(float range, std::uint16_t ring) const {
    return range >= limits_of(ring).min_range_m && range <= static_cast<float>(config_.max_range_m);
  }
  const ChannelLimits& limits_of(std::uint16_t ring) const {
    return by_ring_.empty() ? limits_ : by_ring_[static_cast<std::size_t>(ring - first_ring_)];
  }

  ChannelLimits limits_;  ///< limits of channels without their own ranges
  /// limits of each ring; empty if no channel has a range of its own
  std::vector<ChannelLimits> by_ring_;
  std::vector<float> min_range_by_ring_m_;
  int first_ring_ = 0;
  /// sunlight that a target of reflectance 1 reflects, relative to the crossover of the RangeLaw
  double sun_per_rho_ = 0;
  double day_exponent_ = kLawExponent;
};

/// Returns a warning for each LiDAR with a unit on which the weather has no effect.
std::vector<std::string> weather_warnings(const WeatherConfig& weather,
                                          std::span<const LidarConfig> lidars);

}  // namespace infrasim
