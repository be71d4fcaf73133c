#pragma once

#include <cstdint>

#include "infrasim/config/scene_config.h"
#include "infrasim/core/classes.h"
#include "infrasim/core/geometry.h"

namespace infrasim {

enum class Part : std::uint8_t { kPaint, kGlass, kTyre, kGap, kPlate, kLamp };

/// Where a ray meets a vehicle.
struct BodyHit {
  Class object_class;
  Vec3 size_m;  ///< length, width, height
  Vec3 at;      ///< in the body's unit box, [-0.5, 0.5], x forward, y left
  Vec3 normal;  ///< unit vector in the body's frame; inwards or outwards
};

/// The part of a vehicle that lies at a hit: a matter of place alone, so that it does not depend on
/// the level of detail. Parts that are not asked for are paint.
Part part_at(const BodyHit& hit, const VehicleParts& asked);

/// How a surface sends light back: `reflectance` to all sides, and `gain` times as much towards the
/// LiDAR, as a Lambertian surface that is met at this angle would.
struct Optics {
  float reflectance;
  float gain;
};

/// @param paint reflectance of the vehicle's paint
Optics optics_of(Part part, Class object_class, float paint, double cos_incidence,
                 const VehicleParts& asked);

/// What lies behind a pane: the far side of the cabin, or its floor.
Optics interior_optics(double cos_incidence);

/// Of a ray that goes through a pane and comes back: the share of its power.
inline constexpr float kPaneTwice = 0.25F;

/// Where bodies end above the road.
inline constexpr double kSillHeight_m = 0.2;

/// Whether one can look through the cabin: not of a truck, which has a wall behind its seats.
constexpr bool sees_through(Class object_class) { return object_class != Class::kTruck; }

}  // namespace infrasim
