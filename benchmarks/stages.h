#pragma once

#include <array>
#include <cstddef>
#include <string_view>
#include <vector>

#include "infrasim/pipeline/caster.h"
#include "infrasim/pipeline/simulate.h"

namespace infrasim {

/// The stages of a frame, in their order.
enum class Stage { kMaking, kSelecting, kCasting, kLeaves, kPanes, kBeam, kReturns, kCollecting };

inline constexpr std::array<std::string_view, 8> kStageNames{
    "making rays", "selecting", "casting", "leaves", "panes", "beam", "return model", "collecting"};

/// CPU time of the calling thread.
double thread_cpu_s();

/// Simulates the rays of one LiDAR stage by stage, in the order of Caster::cast, and measures the
/// time of each stage. It calls the public classes, so that the simulator itself has no timers.
class StagedCaster {
 public:
  StagedCaster(const World& world, const LidarConfig& lidar);

  /// Simulates frame k; returns its number of points.
  std::size_t cast(int k);

  /// Total CPU seconds of each stage, which depend less on other processes than wall seconds.
  const std::array<double, kStageNames.size()>& seconds() const { return seconds_; }
  /// Number of rays so far.
  std::size_t rays() const { return rays_done_; }

 private:
  void cast_part(ScannerUnit& scanner, std::int64_t first, std::int64_t last, int k);
  void select(ScannerUnit& scanner, std::int64_t first, std::int64_t last);
  void cast_rays(const ScannerUnit& scanner, std::int64_t first, std::int64_t last);
  void stop_in_leaves(ScannerUnit& scanner, std::int64_t first, std::int64_t last, const Rng& frame,
                      std::uint64_t first_ray);
  void collect(const EchoBatch& echoes, bool wide);

  template <class Work>
  void timed(Stage stage, const Work& work) {
    const double start_s = thread_cpu_s();
    work();
    seconds_[static_cast<std::size_t>(stage)] += thread_cpu_s() - start_s;
  }

  const World& world_;
  Raycaster raycaster_;
  TransparentCaster transparent_;
  std::vector<ScannerUnit> scanners_;
  double reach_ = 0;
  FrameVehicles vehicles_;
  FrameBuilder builder_;
  RayBatch rays_, sub_rays_;
  std::vector<std::uint32_t> selected_, sub_selected_, in_leaves_;
  HitBatch hits_;
  EchoBatch echoes_, beam_echoes_;
  std::vector<float> sunlit_;
  ReturnBatch returns_;
  std::array<double, kStageNames.size()> seconds_{};
  std::size_t rays_done_ = 0;
};

}  // namespace infrasim
