#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "infrasim/core/aggregation.h"
#include "infrasim/core/rng.h"
#include "infrasim/pipeline/frame_builder.h"
#include "infrasim/pipeline/scanner_unit.h"
#include "infrasim/pipeline/stage_times.h"
#include "infrasim/pipeline/transparent.h"
#include "infrasim/pipeline/vehicles.h"
#include "infrasim/raycast/raycaster.h"
#include "infrasim/raycast/volumes.h"
#include "infrasim/sensor/echo_merge.h"
#include "infrasim/sensor/echoes.h"

namespace infrasim {

/// Casts the rays of LiDARs and converts hits to returns, one part of a frame after the other. The
/// steps are: cast the rays, stop them in leaves, continue them behind window panes, merge the
/// echoes of each beam, and detect. A beam that meets a moving object is cast as sub-rays, which
/// all have the static hit of the middle ray. Any other beam is cast as one ray. A caster keeps its
/// buffers between frames. Not thread-safe.
class Caster {
 public:
  /// @param parts  modelled parts of vehicles, used for LiDARs that detect by received power
  /// @param leaves volumes of leaves; must outlive the caster
  Caster(Raycaster& raycaster, const VehicleParts& parts, const Volumes& leaves)
      : raycaster_(raycaster), parts_(parts), leaves_(leaves), transparent_(raycaster) {}

  /// Makes all following casts use only rays that may meet a moving body, and add only returns from
  /// moving bodies. These returns are the same as when all rays are cast.
  void see_bodies_only() { bodies_only_ = true; }

  /// Adds the CPU time of each stage of all following casts to `times`, which must exist during
  /// these casts.
  void measure(StageTimes& times) { times_ = &times; }

  /// Adds the returns of the rays that the unit fires in one slice of frame k.
  /// @param vehicles the vehicles that are set in the raycaster
  /// @return number of rays cast; a static layer makes the number smaller, and wide beams make it
  ///   larger
  std::size_t cast(int k, const WorldSlice& slice, const FrameVehicles& vehicles,
                   ScannerUnit& scanner, FrameBuilder& out);

 private:
  /// Consecutive ray groups of one optical unit that are processed at once.
  struct Part {
    ScannerUnit& scanner;
    const FrameVehicles& vehicles;
    std::int64_t first, last;  ///< first ray group, and one past the last ray group
    double start_s;            ///< start of the frame, seconds
    const Rng& frame;          ///< random numbers of this unit in this frame
    std::uint64_t first_ray;   ///< number of the part's first ray within the frame

    std::int64_t groups() const { return last - first; }
    bool by_power() const { return scanner.returns.needs_reflectance(); }
  };

  void make_rays(const Part& part);
  std::size_t cast_rays(const Part& part);
  void stop_in_leaves(const Part& part);
  std::size_t pass_panes(const Part& part);
  void merge_beams(const Part& part);
  void detect(const Part& part, FrameBuilder& out);
  void make_returned_rays(const Part& part);

  bool loses_rays(const Part& part) const;
  void leave_out_lost(const Part& part, std::vector<std::uint32_t>& numbers) const;
  void select(const Part& part);
  void select_for_bodies(const Part& part);
  void take_static_hits(const Part& part);
  std::size_t cast_beams(const Part& part);
  void cast_sub_rays(const Part& part, std::span<const std::uint32_t> beams, std::size_t from,
                     std::size_t to);
  void keep_beams_on_bodies(const Part& part);
  std::vector<std::uint32_t> mixed_beams(const Part& part) const;
  std::span<const std::uint32_t> order_for_leaves(const Part& part);
  StaticSlice static_hits_of_beams() const;
  void add_other_echoes();
  void choose_echoes(EchoMode mode);
  std::uint32_t ray_of(std::uint32_t echo) const {
    return echo < rays_.size() ? echo : others_[echo - rays_.size()].ray;
  }
  void collect(std::span<const MovingObject> objects, bool wide, FrameBuilder& out) const;

  Raycaster& raycaster_;
  VehicleParts parts_;
  const Volumes& leaves_;
  bool bodies_only_ = false;
  StageTimes* times_ = nullptr;
  TransparentCaster transparent_;
  RayBatch rays_;  ///< rays of the part; with a static layer, only those that can give a point
  std::vector<std::uint32_t> dynamic_;    ///< rays whose direction is needed before detection
  std::vector<std::uint32_t> static_;     ///< rays whose direction is needed only after detection
  std::vector<std::uint32_t> position_;   ///< index in `rays_` of each dynamic ray, by ray number
  std::vector<std::uint32_t> selected_;   ///< rays that must be cast
  std::vector<std::uint32_t> in_leaves_;  ///< rays that may meet leaves
  HitBatch hits_;                         ///< hits of the rays, until they become echoes
  EchoBatch echoes_;                      ///< strongest echo of each ray, then the weaker echoes
  std::vector<std::uint32_t> beams_;      ///< rays that have sub-rays
  RayBatch sub_rays_;                     ///< sub-rays of `beams_`: first the probes of all beams
  std::vector<SubRay> sub_;               ///< beam and power share of each sub-ray
  std::vector<std::uint8_t> sub_number_;  ///< number of each sub-ray within its beam
  std::vector<std::uint32_t> sub_order_;
  std::vector<std::uint32_t> beam_of_;  ///< index in `beams_` of each sub-ray's beam
  HitBatch sub_hits_;
  EchoBatch sub_echoes_;
  std::vector<float> static_range_m_, static_gain_;  ///< hits of `beams_` on static surfaces
  std::vector<std::uint16_t> static_class_;
  std::vector<WeakerEcho> weaker_;     ///< weaker echoes of the sub-rays
  std::vector<WeakerEcho> others_;     ///< weaker echoes of the rays, by ray, then by strength
  std::vector<float> sunlit_;          ///< reflectance of all surfaces in a beam, for sunlight
  std::vector<std::uint32_t> number_;  ///< ray number of each echo, for rays with several echoes
  std::vector<std::uint16_t> ring_;
  std::vector<std::uint8_t> rank_;  ///< rank of each echo by strength among the echoes of its ray
  ReturnBatch returns_;
};

}  // namespace infrasim
