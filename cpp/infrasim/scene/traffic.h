#pragma once

#include "infrasim/scene/site.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// Drives vehicles over the lanes of a scene with the Intelligent Driver Model (Treiber, Hennecke,
/// Helbing 2000) and signals, from a warm start, for the scene's duration. The number of vehicles
/// is held at the density: who leaves at the end of a lane is replaced by a new vehicle at an
/// entry. Vehicles keep their lane: two points of each follow it, so that long ones stay within it
/// round a bend, and those that would not stay within a turn go straight on.
/// @param sink     is given the vehicles every 0.1 s, rounded to the digits of the trajectory file
/// @param instants of the scene's that are wanted: no more are simulated
/// @throws ConfigError if vehicles of a class do not fit the lanes
void simulate_traffic(const Site& site, const StateSink& sink, int instants);
/// The same for the scene's duration.
void simulate_traffic(const Site& site, const StateSink& sink);
/// The same, all rows at once.
Trajectories simulate_traffic(const Site& site);

}  // namespace infrasim
