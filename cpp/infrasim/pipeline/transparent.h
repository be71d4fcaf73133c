#pragma once

#include <limits>
#include <span>
#include <vector>

#include "infrasim/pipeline/static_layer.h"
#include "infrasim/pipeline/vehicles.h"
#include "infrasim/raycast/raycaster.h"
#include "infrasim/sensor/echo_path.h"
#include "infrasim/sensor/echoes.h"
#include "infrasim/sensor/vehicle_parts.h"

namespace infrasim {

/// Turns hits into echoes: finds what rays meet on vehicles, and casts them on where it lets them
/// through: panes, with the power that is left, and the air below bodies. Keeps its buffers. For
/// one thread at a time.
class TransparentCaster {
 public:
  explicit TransparentCaster(Raycaster& raycaster) : raycaster_(raycaster) {}

  /// The strongest echo, beyond the blind zone, of what each ray meets on its way.
  /// @param vehicles    those that the raycaster has
  /// @param hits        nearest ones, with incidence; they become the echoes
  /// @param path        to the echoes
  /// @param background  hits of the rays with what stands still; empty: it is cast
  /// @return how many rays were cast on, a ray as often as it was
  std::size_t resolve(const RayBatch& rays, const FrameVehicles& vehicles,
                      const VehicleParts& parts, const EchoPath& path, HitBatch& hits,
                      EchoBatch& echoes, const StaticSlice& background = {});

 private:
  /// A ray that goes on.
  struct Passing {
    std::uint32_t ray = 0;
    std::int32_t object = -1;  ///< that it is in or under; -1: none
    bool under = false;        ///< it, not in it
    float power = 1;           ///< what panes have left of it
    float near = 0;            ///< from where it goes on; 0: it comes from the sensor
    float floor_range = std::numeric_limits<float>::infinity();  ///< to the floor of a cabin
  };

  void cast_on(const RayBatch& rays);
  void cast_on_with(const StaticSlice& background);
  void meet(const RayBatch& rays, const Passing& state, const Hit& hit);
  void meet_vehicle(const RayBatch& rays, const Passing& state, const Hit& hit);
  void meet_below(const BodyHit& body, Part part, const Passing& state, const Hit& hit);
  BodyHit body_hit(const Hit& hit) const;
  Echo background_echo(float range, Class material, std::uint32_t ray, float cosine) const;
  void keep_strongest(const Passing& state, Echo echo);

  Raycaster& raycaster_;
  const FrameVehicles* vehicles_ = nullptr;
  VehicleParts parts_;
  EchoPath path_;
  StaticSlice background_;
  EchoBatch* echoes_ = nullptr;
  std::vector<Passing> passing_;  ///< rays to be cast on
  std::vector<Passing> next_;     ///< those that go on after that
  RayBatch on_;
  std::vector<std::uint32_t> on_order_;
  HitBatch on_hits_;
};

}  // namespace infrasim
