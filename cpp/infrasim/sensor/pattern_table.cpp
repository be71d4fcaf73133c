#include "infrasim/sensor/pattern_table.h"

#include <algorithm>
#include <cmath>

#include "infrasim/core/errors.h"
#include "infrasim/core/math.h"
#include "infrasim/core/rng.h"

namespace infrasim {

namespace {

// maximum time for which free motors turn before the start of a run
constexpr double kPhaseSpan_s = 600;
constexpr double kMostRows = 2e8;  // maximum number of rows: 4.8 GB

MotorPhase motor_phase(const PatternConfig& pattern) {
  if (pattern.spinning) return pattern.spinning->phase;
  return pattern.prisms ? pattern.prisms->phase : pattern.table->phase;
}

void check_rows(const LidarConfig& lidar, int frames) {
  double rows = 0;
  for (const LidarUnit& unit : lidar.units)
    rows += rays_per_s(unit.pattern) * period_s(lidar) * frames;
  if (rows > kMostRows)
    throw ConfigError("frames: expected at most " + std::to_string(std::llround(kMostRows)) +
                      " rays, got about " + std::to_string(std::llround(rows)) + " rays in " +
                      std::to_string(frames) + " frames");
}

}  // namespace

double start_phase_s(std::uint64_t seed, const std::string& mount, const LidarConfig& lidar,
                     std::size_t unit) {
  if (motor_phase(lidar.units[unit].pattern) == MotorPhase::kLocked) return 0;
  return kPhaseSpan_s * Rng::of(seed, "phase").at(hash_name(mount)).at(unit).uniform(0);
}

std::vector<double> pattern_table(const LidarConfig& lidar, int first, int last, int step,
                                  std::optional<std::uint64_t> seed, const std::string& mount) {
  check_rows(lidar, 1 + (last - 1 - first) / step);
  const double frame_s = period_s(lidar);
  std::vector<double> rows;
  for (std::size_t u = 0; u < lidar.units.size(); ++u) {
    const LidarUnit& unit = lidar.units[u];
    const Mat3 pose = rotation(rad(unit.yaw_deg), rad(unit.pitch_deg), 0);
    const double phase_s = seed ? start_phase_s(*seed, mount, lidar, u) : 0;
    const ScanPattern pattern(unit.pattern, phase_s, pose, 0);
    for (std::int64_t k = first; k < last; k += step) {
      const RayRange range = pattern.fired_between(static_cast<double>(k) * frame_s,
                                                   static_cast<double>(k + 1) * frame_s);
      for (std::int64_t i = range.first; i < range.last; ++i) {
        const Ray ray = pattern.ray(i);
        const Vec3 d = pose * ray.direction;
        // Rounding makes the z component of some vertical rays of tilted units larger than 1.
        const double sine = std::clamp(d.z, -1.0, 1.0);
        rows.insert(rows.end(), {math::atan2(d.y, d.x), math::asin(sine), ray.time_s});
      }
    }
  }
  return rows;
}

std::vector<FieldOfView> fields_of_view(const LidarConfig& lidar) {
  std::vector<FieldOfView> views;
  for (const LidarUnit& unit : lidar.units) try {
      views.push_back(field_of_view(ScanPattern(unit.pattern, 0, rotation(0, 0, 0), 0)));
    } catch (const ConfigError& error) {
      throw ConfigError(lidar.name + ": " + error.what());
    }
  return views;
}

}  // namespace infrasim
