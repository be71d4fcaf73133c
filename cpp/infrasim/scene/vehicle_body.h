#pragma once

#include "infrasim/config/scene_config.h"
#include "infrasim/core/classes.h"
#include "infrasim/core/geometry.h"
#include "infrasim/core/triangle_mesh.h"

namespace infrasim {

/// Builds the body of a class as a closed mesh in the unit box [-0.5, 0.5]^3, x forward. The mesh
/// touches all six faces. An instance is scaled to an object's box, so the box always encloses the
/// mesh. Number of triangles: 12 in `box`, about 100 in `low`, about 600 in `mid`, and about 6,000
/// in `fine`, which is used only for comparison. A cyclist has many parts and 280 triangles in
/// `low`.
TriangleMesh build_vehicle_body(Class object_class, Detail detail);

/// Returns the box that a vehicle's body fills. The box is 0.5 mm inside the label box at the
/// sides, and its bottom is 1 mm higher. No face of a body therefore coincides with the road or
/// with a touching vehicle. If faces coincided, a hit would depend on the order of rays.
Box3d body_box(const Box3d& vehicle);

}  // namespace infrasim
