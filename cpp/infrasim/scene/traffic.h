#pragma once

#include "infrasim/scene/site.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// Simulates vehicles on the lanes of a scene for the scene's duration, from a warm start, with
/// signals and the Intelligent Driver Model (Treiber, Hennecke, Helbing 2000). The number of
/// vehicles follows the density: a vehicle that leaves at the end of a lane is replaced by a new
/// one at an entry. Vehicles keep their lane. Two points of each vehicle follow the lane, so that
/// long vehicles stay within it in a bend. Vehicles that would not stay within a turn go straight
/// on.
/// @param sink     gets the vehicles every 0.1 s, rounded to the digits of the trajectory file
/// @param instants number of instants to simulate
/// @throws ConfigError if vehicles of a class do not fit the lanes
void simulate_traffic(const Site& site, const StateSink& sink, int instants);
/// As above, for the scene's duration.
void simulate_traffic(const Site& site, const StateSink& sink);
/// As above, returning all rows at once.
Trajectories simulate_traffic(const Site& site);

}  // namespace infrasim
