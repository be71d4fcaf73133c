#pragma once

#include <optional>
#include <vector>

#include "infrasim/scene/roads.h"
#include "infrasim/scene/roundabout.h"

namespace infrasim {

enum class Turn { kStraight, kLeft, kRight };

/// A directed strip that vehicles follow. Lanes of a road run from its ends (or its junction) to
/// its ends; inside a junction a lane connects an approach to an exit.
struct Lane {
  Curve curve;
  double elevation_m = 0;
  double width_m = 3.5;
  double speed_limit_m_s = kInf;
  bool entry = false;  ///< vehicles appear at its start
  int approach = -1;   ///< signal that stands at its end; -1: none
  int junction = -1;   ///< of a connecting lane
  int leaves = -1;     ///< junction at its start; -1: none
  Turn turn = Turn::kStraight;
  std::vector<int> next;  ///< lanes that follow
};

/// The part of a road that a junction takes, by stations of its centreline.
struct JunctionCut {
  int junction = 0;
  double from = 0;
  double to = 0;
};

struct LaneNetwork {
  std::vector<Lane> lanes;
  std::vector<std::optional<JunctionCut>> cuts;  ///< of each road
  std::vector<int> approach_junctions;           ///< of each signal, one per arm of a junction
  std::vector<JunctionConfig> junctions;
  std::vector<std::optional<Ring>> rings;  ///< of each junction
};

/// Two roads make a junction where they cross, or where one ends on the other (a T).
/// @param centrelines of the scene's roads
/// @throws ConfigError if a junction names an unknown road, or joins roads that do not meet, lie
/// at different heights, or meet at an angle that traffic can't drive
LaneNetwork build_lane_network(const SceneConfig& scene, std::span<const Curve> centrelines);

}  // namespace infrasim
