#pragma once

#include <limits>
#include <span>
#include <vector>

#include "infrasim/pipeline/static_layer.h"
#include "infrasim/pipeline/vehicles.h"
#include "infrasim/raycast/raycaster.h"
#include "infrasim/sensor/echo_merge.h"
#include "infrasim/sensor/echo_path.h"
#include "infrasim/sensor/echoes.h"
#include "infrasim/sensor/vehicle_parts.h"

namespace infrasim {

/// Converts hits to echoes, depending on the part of a vehicle that each ray meets. A ray that
/// passes through a window pane continues with the remaining power, and a ray can also continue
/// below a vehicle. Such rays are cast again. The object keeps its buffers between calls. Not
/// thread-safe.
class TransparentCaster {
 public:
  explicit TransparentCaster(Raycaster& raycaster) : raycaster_(raycaster) {}

  /// Finds the strongest echo of each ray beyond the blind zone.
  /// @param rays        directions, times and rings
  /// @param vehicles    the vehicles that are set in the raycaster
  /// @param hits        nearest hits, with incidence; their columns are moved to `echoes`
  /// @param path        attenuation between LiDAR and echo
  /// @param background  hits of the rays on static surfaces, if they are known; if empty, the rays
  ///   are cast at these surfaces too
  /// @param weaker      if not null, receives the weaker echoes, by increasing index of the ray
  /// @return number of rays that were cast again, counted once for each additional cast
  std::size_t resolve(const RayBatch& rays, const FrameVehicles& vehicles,
                      const VehicleParts& parts, const EchoPath& path, HitBatch& hits,
                      EchoBatch& echoes, const StaticSlice& background = {},
                      std::vector<WeakerEcho>* weaker = nullptr);

 private:
  /// A ray that is cast again.
  struct Passing {
    std::uint32_t ray = 0;
    std::int32_t object = -1;  ///< vehicle that the ray is inside or under; -1 if none
    bool under = false;        ///< whether the ray is under the vehicle, not inside it
    float power = 1;           ///< share of power that remains behind the panes
    float near = 0;            ///< range at which the ray continues; 0 at the sensor
    float floor_range = std::numeric_limits<float>::infinity();  ///< range to the cabin floor
  };

  void cast_on(const RayBatch& rays);
  void cast_on_with(const StaticSlice& background);
  void meet(const RayBatch& rays, const Passing& state, const Hit& hit);
  void meet_vehicle(const RayBatch& rays, const Passing& state, const Hit& hit);
  void meet_below(const RayBatch& rays, const BodyHit& body, Part part, const Passing& state,
                  const Hit& hit);
  BodyHit body_hit(const Hit& hit) const;
  Echo background_echo(float range, Class material, std::uint32_t ray, float cosine) const;
  void keep_strongest(const RayBatch& rays, const Passing& state, Echo echo);

  Raycaster& raycaster_;
  const FrameVehicles* vehicles_ = nullptr;
  VehicleParts parts_;
  EchoPath path_;
  StaticSlice background_;
  EchoBatch* echoes_ = nullptr;
  std::vector<WeakerEcho>* weaker_ = nullptr;
  std::vector<Passing> passing_;  ///< rays of the current additional cast
  std::vector<Passing> next_;     ///< rays of the next additional cast
  RayBatch on_;
  std::vector<std::uint32_t> on_order_;
  HitBatch on_hits_;
};

}  // namespace infrasim
