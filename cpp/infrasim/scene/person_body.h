#pragma once

#include "infrasim/config/scene_config.h"
#include "infrasim/core/triangle_mesh.h"

// Builds the bodies of pedestrians and cyclists in the unit box, for build_vehicle_body. The
// functions do not support the level of detail `box`.

namespace infrasim {

/// Builds a pedestrian in mid-stride whose head, trunk, arms and legs are ellipsoids. The body is
/// symmetric under half a turn about z.
TriangleMesh build_pedestrian(Detail detail);

/// Builds a rider of ellipsoids on a bicycle. The bicycle has two rings as wheels, a frame and a
/// handlebar. The body is symmetric left to right.
TriangleMesh build_cyclist(Detail detail);

}  // namespace infrasim
