#pragma once

#include "infrasim/config/scene_config.h"
#include "infrasim/core/classes.h"
#include "infrasim/core/geometry.h"
#include "infrasim/core/triangle_mesh.h"

namespace infrasim {

/// Body of a class in the unit box [-0.5, 0.5]^3, x forward, closed, touching all six faces; an
/// instance scales it to its box, which therefore encloses the mesh by construction.
/// Triangles: box 12, low about 100, mid about 600, fine about 6,000 (a reference only); a cyclist,
/// who is of many parts, has 280 in low.
TriangleMesh build_vehicle_body(Class object_class, Detail detail);

/// The box that a vehicle's body fills: 0.5 mm inside its own at the sides and 1 mm above its
/// bottom. So no face of a body lies in the road, or in that of a vehicle that touches it, where
/// the order of rays would say which one is hit.
Box3d body_box(const Box3d& vehicle);

}  // namespace infrasim
