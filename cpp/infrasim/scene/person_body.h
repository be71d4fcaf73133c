#pragma once

#include "infrasim/config/scene_config.h"
#include "infrasim/core/triangle_mesh.h"

// Bodies of people in the unit box, as build_vehicle_body hands them out; no detail `box` here.

namespace infrasim {

/// Head, trunk, arms and legs of ellipsoids, in a stride: half a turn about z makes it itself.
TriangleMesh build_pedestrian(Detail detail);

/// A rider of ellipsoids on a bicycle: two rings, a frame and a handlebar; left and right alike.
TriangleMesh build_cyclist(Detail detail);

}  // namespace infrasim
