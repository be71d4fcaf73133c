#pragma once

#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "infrasim/config/tree.h"
#include "infrasim/core/geometry.h"

// Structs with the keys of vehicles and people in a scene file.

namespace infrasim {

struct SpeedConfig {
  double mean_km_h = 50;
  double std_km_h = 3;
};

inline constexpr double kStandstillGap_m = 2;  ///< gap between two vehicles that stand in a queue

struct TrafficConfig {
  double vehicles_per_km_lane = 12;
  SpeedConfig speed;
  double warm_up_s = 100;
  std::map<std::string, double> class_shares;
  config::Place place;
};

/// A row of parked vehicles along a road.
struct ParkedConfig {
  std::string road;
  double offset_m = 0;  ///< offset of the vehicles' centres, positive to the left of the centreline
  double from_m = 0;
  double to_m = 1e9;
  double turn_deg = 0;    ///< angle of the vehicles relative to the road's direction
  double gap_m = 1;       ///< mean gap between two vehicles
  double occupied = 0.8;  ///< share of the spaces with a vehicle
  double base_m = 0;      ///< height of the vehicles' base above the road
  std::map<std::string, double> class_shares;
  config::Place place;
};

enum class PersonKind { kPedestrian, kCyclist };

std::span<const char* const> enum_names(PersonKind);

struct PersonSpeedConfig {
  double mean_km_h = 5;
  double std_km_h = 0.5;
};

/// Pedestrians or cyclists that move along a line beside a road, in both directions.
struct PeopleConfig {
  std::string road;
  double offset_m = 0;  ///< offset of the line from the road's centreline, positive to the left
  double from_m = 0;
  double to_m = 1e9;
  double per_km = 0;  ///< number of people per kilometre of the line, in both directions together
  PersonKind kind = PersonKind::kPedestrian;  ///< object class; value of the key `class`
  PersonSpeedConfig speed;
  config::Place place;
};

/// Pedestrians who stand close together, as at a crossing or a stop.
struct StandingPeopleConfig {
  double x_m = 0;  ///< world x of the centre of the group
  double y_m = 0;
  int count = 4;
  double spacing_m = 1.3;  ///< mean distance between neighbours
  double base_m = 0;       ///< world z of the ground under the group
  config::Place place;
};

}  // namespace infrasim
