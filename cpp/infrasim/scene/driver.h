#pragma once

#include "infrasim/scene/traffic_signals.h"
#include "infrasim/scene/traffic_state.h"

// What a driver does in a step, by the Intelligent Driver Model (Treiber, Hennecke, Helbing 2000).

namespace infrasim {

// Usual values for mixed traffic (Treiber, Kesting 2013, table 11.2).
inline constexpr double kBraking = 2.0;  ///< m/s2, comfortable
inline constexpr double kTimeGap = 1.2;  ///< s

/// Gives every vehicle without one the lane that it takes next.
void choose_next_lanes(TrafficState& state, const TrafficSignals& signals);

/// Commits who could no longer stop if its green signal turned red: it will drive on.
void commit_at_green(TrafficState& state, const TrafficSignals& signals);

/// m/s2 of vehicle i of a lane.
double acceleration(const TrafficState& state, const TrafficSignals& signals, int lane,
                    std::size_t i);

/// Moves a vehicle along its lane for one step.
void advance(Vehicle& v, double acceleration);

}  // namespace infrasim
