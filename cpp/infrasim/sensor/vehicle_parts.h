#pragma once

#include <cstdint>

#include "infrasim/config/scene_config.h"
#include "infrasim/core/classes.h"
#include "infrasim/core/geometry.h"

namespace infrasim {

enum class Part : std::uint8_t { kPaint, kGlass, kTyre, kGap, kPlate, kLamp };

/// Position at which a ray meets a vehicle.
struct BodyHit {
  Class object_class;
  Vec3 size_m;  ///< length, width, height
  Vec3 at;      ///< position in the body's unit box, [-0.5, 0.5], x forward, y left
  Vec3 normal;  ///< unit vector in the body's frame, pointing inwards or outwards
};

/// Returns the part of a vehicle that a ray hits. The part depends on the position, but not on the
/// mesh's level of detail. Parts that are false in `asked` count as paint.
Part part_at(const BodyHit& hit, const VehicleParts& asked);

/// Optical properties of a surface: diffuse `reflectance`, and `gain`, the power towards the LiDAR
/// relative to a Lambertian surface at normal incidence.
struct Optics {
  float reflectance;
  float gain;
};

/// @param paint reflectance of the vehicle's paint
Optics optics_of(Part part, Class object_class, float paint, double cos_incidence,
                 const VehicleParts& asked);

/// Returns the optical properties of the surface behind a pane: the far side or the floor of the
/// cabin.
Optics interior_optics(double cos_incidence);

/// Share of the power that remains after light has passed a pane twice, once in each direction.
inline constexpr float kPaneTwice = 0.25F;

/// Height of the lower edge of vehicle bodies above the road.
inline constexpr double kSillHeight_m = 0.2;

/// Returns whether rays can pass through the cabin. They cannot in a truck, which has a wall behind
/// the seats.
constexpr bool sees_through(Class object_class) { return object_class != Class::kTruck; }

}  // namespace infrasim
