#pragma once

#include "infrasim/config/scene_config.h"
#include "infrasim/core/triangle_mesh.h"

// Bodies of pedestrians and cyclists in the unit box, for build_vehicle_body. There is no detail
// `box` here.

namespace infrasim {

/// Head, trunk, arms and legs as ellipsoids, in mid-stride. The body is symmetric under half a turn
/// about z.
TriangleMesh build_pedestrian(Detail detail);

/// A rider of ellipsoids on a bicycle of two rings, a frame and a handlebar; symmetric left to
/// right.
TriangleMesh build_cyclist(Detail detail);

}  // namespace infrasim
