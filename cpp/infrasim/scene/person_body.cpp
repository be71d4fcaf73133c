#include "infrasim/scene/person_body.h"

#include "infrasim/scene/solids.h"

namespace infrasim {

namespace {

/// Number of facets for each kind of part.
struct Facets {
  int bands, sectors;  ///< bands and sectors of an ellipsoid
  int segments;        ///< segments of a wheel
  int sides;           ///< sides of a bar
};

Facets facets_of(Detail detail) {
  switch (detail) {
    case Detail::kMid:
      return {6, 10, 16, 6};
    case Detail::kFine:
      return {20, 24, 48, 12};
    default:
      return {3, 6, 8, 3};
  }
}

// Assumed dimensions, in metres, of an adult of 1.77 m, and of a cyclist of 1.67 m on a 28-inch
// bicycle.
constexpr Ellipsoid kHead{{0, 0, 1.645}, {.10, .085, .125}};
constexpr Ellipsoid kTrunk{{0, 0, 1.16}, {.12, .19, .37}};
constexpr Ellipsoid kLeftArm{{-.10, .275, 1.11}, {.05, .05, .34}, .12};
constexpr Ellipsoid kLeftLeg{{.16, .095, .46}, {.085, .08, .46}, -.17};

constexpr Ellipsoid kRiderHead{{.20, 0, 1.545}, {.10, .085, .125}};
constexpr Ellipsoid kRiderTrunk{{-.04, 0, 1.17}, {.12, .19, .33}, .17};
constexpr Ellipsoid kRiderLeftArm{{.24, .22, 1.19}, {.05, .05, .23}, -.13};
constexpr Ellipsoid kRiderLeftLeg{{-.06, .11, .60}, {.085, .075, .38}, -.13};

constexpr double kWheelRadius = .34, kTyreDepth = .045, kTyreWidth = .045, kTube = .02;
constexpr Vec3 kRearAxle{-.495, 0, .34}, kFrontAxle{.495, 0, .34};
constexpr Vec3 kCrank{-.05, 0, .29}, kSaddle{-.22, 0, .92}, kStem{.36, 0, .95};
constexpr double kHalfHandlebar = .35;

Ellipsoid mirrored(Ellipsoid e) {
  e.centre.y = -e.centre.y;
  return e;
}

Ellipsoid turned_half(Ellipsoid e) {
  e.centre.x = -e.centre.x;
  e.centre.y = -e.centre.y;
  e.lean = -e.lean;
  return e;
}

}  // namespace

TriangleMesh build_pedestrian(Detail detail) {
  const Facets facets = facets_of(detail);
  TriangleMesh mesh;
  for (const Ellipsoid& part :
       {kHead, kTrunk, kLeftArm, turned_half(kLeftArm), kLeftLeg, turned_half(kLeftLeg)})
    add_ellipsoid(mesh, part, facets.bands, facets.sectors);
  return in_unit_box(std::move(mesh));
}

TriangleMesh build_cyclist(Detail detail) {
  const Facets facets = facets_of(detail);
  TriangleMesh mesh;
  for (const Ellipsoid& part : {kRiderHead, kRiderTrunk, kRiderLeftArm, mirrored(kRiderLeftArm),
                                kRiderLeftLeg, mirrored(kRiderLeftLeg)})
    add_ellipsoid(mesh, part, facets.bands, facets.sectors);
  for (const Vec3 axle : {kRearAxle, kFrontAxle})
    add_ring(mesh, axle, kWheelRadius, kTyreDepth, kTyreWidth, facets.segments);
  const auto bar = [&](Vec3 from, Vec3 to) { add_bar(mesh, from, to, kTube, facets.sides); };
  bar(kRearAxle, kCrank);
  bar(kCrank, kSaddle);
  bar(kCrank, kStem);
  bar(kStem, kFrontAxle);
  const Vec3 aside{0, kHalfHandlebar, 0};
  bar(kStem - aside, kStem + aside);
  return in_unit_box(std::move(mesh));
}

}  // namespace infrasim
