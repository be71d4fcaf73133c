#pragma once

#include "infrasim/scene/traffic_signals.h"
#include "infrasim/scene/traffic_state.h"

// Computes a driver's behaviour in one time step with the Intelligent Driver Model (Treiber,
// Hennecke, Helbing 2000).

namespace infrasim {

// Usual parameters of drivers in mixed traffic (Treiber, Kesting 2013, table 11.2).
inline constexpr double kBraking = 2.0;  ///< m/s2, comfortable braking
inline constexpr double kTimeGap = 1.2;  ///< s, desired time gap to the vehicle ahead

/// Chooses the next lane of every vehicle that has no next lane yet.
void choose_next_lanes(TrafficState& state, const TrafficSignals& signals);

/// Marks vehicles that could no longer stop if their green signal turned red. These vehicles do not
/// stop at the signal.
void commit_at_green(TrafficState& state, const TrafficSignals& signals);

/// Returns the acceleration (m/s2) of vehicle i of a lane.
double acceleration(const TrafficState& state, const TrafficSignals& signals, int lane,
                    std::size_t i);

/// Moves a vehicle along its lane by one time step.
void advance(Vehicle& v, double acceleration);

}  // namespace infrasim
