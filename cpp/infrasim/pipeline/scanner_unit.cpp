#include "infrasim/pipeline/scanner_unit.h"

#include "infrasim/sensor/pattern_table.h"

namespace infrasim {

namespace {

/// @param unit       index in the LiDAR's units
/// @param first_ring ring number of the unit's lowest laser
ScannerUnit make_scanner_unit(const SceneConfig& scene, const LidarConfig& lidar, std::size_t unit,
                              int first_ring, const std::string& stream_prefix) {
  const LidarUnit& config = lidar.units[unit];
  const Mat3 pose = unit_pose(scene, config);
  const auto& [name, mount] = *scene.mounts.begin();
  const std::string mount_prefix =
      mount.own_random_stream.value_or(false) ? "mount " + name + " " : "";
  const std::string unit_suffix = unit == 0 ? "" : "/" + std::to_string(unit);
  const auto& beam = config.returns.beam;
  const bool one_echo =
      !config.returns.echoes || config.returns.echoes->mode == EchoMode::kStrongest;
  const auto& spinning = config.pattern.spinning;
  const std::vector<Channel> channels =
      spinning ? channels_by_ring(*spinning) : std::vector<Channel>{};
  return {
      ScanPattern(config.pattern, start_phase_s(scene.seed, name, lidar, unit), pose, first_ring),
      ReturnModel(config.returns, scene.weather, channels, first_ring),
      beam || !one_echo ? std::optional<Beam>(Beam(beam, pose)) : std::nullopt,
      static_cast<float>(config.returns.max_range_m),
      period_s(config.pattern),
      Rng::of(scene.seed, stream_prefix + mount_prefix + lidar.name + unit_suffix),
      {},
      {}};
}

}  // namespace

RayRange ScannerUnit::rays(int k, double from, double to) const {
  return pattern.fired_between((k + from) * period_s, (k + to) * period_s);
}

Mat3 unit_pose(const SceneConfig& scene, const LidarUnit& unit) {
  const MountConfig& mount = scene.mounts.begin()->second;
  return rotation(0, rad(mount.pitch_deg), rad(mount.roll_deg)) *
         rotation(rad(unit.yaw_deg), rad(unit.pitch_deg), 0);
}

std::vector<ScannerUnit> make_scanner_units(const SceneConfig& scene, const LidarConfig& lidar,
                                            const std::string& stream_prefix) {
  std::vector<ScannerUnit> scanners;
  int first_ring = 0;
  for (std::size_t i = 0; i < lidar.units.size(); ++i) {
    scanners.push_back(make_scanner_unit(scene, lidar, i, first_ring, stream_prefix));
    first_ring += scanners.back().pattern.rings();
  }
  return scanners;
}

}  // namespace infrasim
