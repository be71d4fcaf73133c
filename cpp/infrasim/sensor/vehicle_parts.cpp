#include "infrasim/sensor/vehicle_parts.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "infrasim/core/math.h"

namespace infrasim {

namespace {

/// Positions of windows and wheels of a class, as shares of the box unless stated otherwise. The
/// values are nominal and fit the profiles in scene/vehicle_body.cpp.
struct Layout {
  double belt, window_top;         ///< lower and upper edge of the windows, as shares of the height
  double cabin_rear, cabin_front;  ///< ends of the cabin with its windows, as shares of the length
  double window_rear, window_front;  ///< ends of the side windows, as shares of the length
  int side_windows;
  double rear_axle, front_axle;  ///< positions of the axles, as shares of the length
  double wheel_radius_m;
};

// tolerance of a hit on the front or rear face, as a share of the length; rounding errors are
// smaller
constexpr double kOnFace = 1e-3;
constexpr double kPillar_m = 0.14;  // width of the pillar between two side windows
// half the width of windscreen and rear window, as a share of the vehicle's width
constexpr double kScreenHalfWidth = 0.38;
constexpr double kRoofNormal = 0.95;  // minimum z component of a roof's normal
constexpr double kTyreInner = 0.62;   // inner radius of the tyre as a share of the wheel's radius

constexpr Layout kCar{.58, .95, -.46, .23, -.38, .17, 2, -.29, .29, .32};
constexpr Layout kVan{.50, .95, -.50, .35, -.48, .26, 3, -.30, .31, .34};
constexpr Layout kTruck{.50, .80, .20, .50, .25, .42, 1, -.30, .36, .48};
constexpr Layout kBus{.50, .85, -.50, .50, -.46, .46, 6, -.24, .27, .48};

/// Returns the layout of a class of vehicles with four wheels; null for other classes.
const Layout* layout_of(Class object_class) {
  switch (object_class) {
    case Class::kCar:
      return &kCar;
    case Class::kVan:
      return &kVan;
    case Class::kTruck:
      return &kTruck;
    case Class::kBus:
      return &kBus;
    default:
      return nullptr;
  }
}

bool is_side(const BodyHit& hit) { return std::abs(hit.normal.y) > std::abs(hit.normal.x); }

bool is_glass(const BodyHit& hit, const Layout& body) {
  const double height = hit.at.z + 0.5;
  if (height < body.belt || height > body.window_top || std::abs(hit.normal.z) > kRoofNormal ||
      hit.at.x < body.cabin_rear - kOnFace || hit.at.x > body.cabin_front + kOnFace)
    return false;
  if (!is_side(hit)) return std::abs(hit.at.y) < kScreenHalfWidth;
  if (hit.at.x < body.window_rear || hit.at.x > body.window_front) return false;
  const double pitch = (body.window_front - body.window_rear) / body.side_windows;
  const double place = std::fmod(hit.at.x - body.window_rear, pitch) * hit.size_m.x;
  return place < pitch * hit.size_m.x - kPillar_m;
}

bool is_tyre(const BodyHit& hit, const Layout& body) {
  if (!is_side(hit)) return false;
  const double z = (hit.at.z + 0.5) * hit.size_m.z - body.wheel_radius_m;
  for (const double axle : {body.rear_axle, body.front_axle}) {
    const double x = (hit.at.x - axle) * hit.size_m.x;
    const double share = math::hypot(x, z) / body.wheel_radius_m;
    if (share > kTyreInner && share < 1) return true;
  }
  return false;
}

/// Returns the number plate or lamp at a hit, if there is one. Number plates are 520 x 110 mm in
/// Europe. The positions of plates and lamps are nominal.
std::optional<Part> reflector(const BodyHit& hit) {
  if (std::abs(hit.at.x) < 0.42 || std::abs(hit.normal.x) < 0.7) return std::nullopt;
  const double z = (hit.at.z + 0.5) * hit.size_m.z, y = std::abs(hit.at.y) * hit.size_m.y;
  if (y < 0.26 && z > 0.40 && z < 0.51) return Part::kPlate;
  const bool front = hit.at.x > 0;
  const double low = front ? 0.50 : 0.70, high = front ? 0.65 : 0.90;
  if (std::abs(hit.at.y) > 0.28 && z > low && z < high) return Part::kLamp;
  return std::nullopt;
}

constexpr double kCoatIndex = 1.5;  // refractive index of clear coat

/// Returns the share of unpolarised light that passes from air into the coat (Fresnel).
double into_coat(double cos_incidence) {
  const double n = kCoatIndex, c = cos_incidence;
  const double inside = std::sqrt(n * n - 1 + c * c);  // n times the cosine of the refracted ray
  const double s = (c - inside) / (c + inside);
  const double p = (n * n * c - inside) / (n * n * c + inside);
  return 1 - (s * s + p * p) / 2;
}

constexpr float kTyreReflectance = 0.04F;
constexpr float kInteriorReflectance = 0.05F;
constexpr Optics kPlateOptics{.reflectance = 0.6F, .gain = 10};
constexpr Optics kLampOptics{.reflectance = 0.3F, .gain = 4};
constexpr float kGlassReflectance = 0.003F;  // diffuse reflectance of dust on a pane
// power of a glint relative to a white Lambertian surface: two faces of a pane reflect 4 % each,
// with a gain of 20
constexpr float kGlint = 1.6F;
// cosine of 3 degrees, the maximum angle of incidence of a glint
constexpr double kGlintCosine = 0.99863;

}  // namespace

Part part_at(const BodyHit& hit, const VehicleParts& asked) {
  const Layout* body = layout_of(hit.object_class);
  if (body == nullptr) return Part::kPaint;
  const bool low = (hit.at.z + 0.5) * hit.size_m.z < kSillHeight_m;
  if ((asked.tyres || low) && is_tyre(hit, *body)) return asked.tyres ? Part::kTyre : Part::kPaint;
  if (asked.gap && low) return Part::kGap;
  if (asked.glass && is_glass(hit, *body)) return Part::kGlass;
  return (asked.reflectors ? reflector(hit) : std::nullopt).value_or(Part::kPaint);
}

Optics optics_of(Part part, Class object_class, float paint, double cos_incidence,
                 const VehicleParts& asked) {
  const auto lambert = static_cast<float>(cos_incidence);
  switch (part) {
    case Part::kGlass:
      if (cos_incidence > kGlintCosine) return {kGlassReflectance, kGlint / kGlassReflectance};
      return {kGlassReflectance, lambert};
    case Part::kTyre:
      return {kTyreReflectance, lambert};
    case Part::kPlate:
      return kPlateOptics;
    case Part::kLamp:
      return kLampOptics;
    default:
      break;
  }
  if (!asked.coat || !class_of(object_class).vehicle) return {paint, lambert};
  // The paint's reflectance is defined for normal incidence in both directions.
  const double passed = into_coat(cos_incidence) / into_coat(1);
  return {paint, lambert * static_cast<float>(passed * passed)};
}

Optics interior_optics(double cos_incidence) {
  return {kInteriorReflectance, static_cast<float>(cos_incidence)};
}

}  // namespace infrasim
