#pragma once

#include "infrasim/config/scene_config.h"
#include "infrasim/core/classes.h"
#include "infrasim/core/triangle_mesh.h"

namespace infrasim {

/// Body of a class in the unit box [-0.5, 0.5]^3, x forward, closed, touching all six faces; an
/// instance scales it to its box, which therefore encloses the mesh by construction.
/// Triangles: box 12, low about 100, mid about 600, fine about 6,000 (a reference only).
TriangleMesh build_vehicle_body(Class object_class, Detail detail);

}  // namespace infrasim
