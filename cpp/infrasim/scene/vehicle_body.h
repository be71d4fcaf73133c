#pragma once

#include "infrasim/config/scene_config.h"
#include "infrasim/core/classes.h"
#include "infrasim/core/geometry.h"
#include "infrasim/core/triangle_mesh.h"

namespace infrasim {

/// Body of a class in the unit box [-0.5, 0.5]^3, x forward, closed, touching all six faces. An
/// instance is scaled to its box, so the box always encloses the mesh. Number of triangles: box 12,
/// low about 100, mid about 600, fine about 6,000 (a reference only). A cyclist has many parts and
/// 280 triangles in low.
TriangleMesh build_vehicle_body(Class object_class, Detail detail);

/// The box that a vehicle's body fills: 0.5 mm inside its label box at the sides and 1 mm above its
/// bottom. So no face of a body coincides with the road or with a touching vehicle, where the hit
/// would depend on the order of rays.
Box3d body_box(const Box3d& vehicle);

}  // namespace infrasim
