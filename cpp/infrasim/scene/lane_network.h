#pragma once

#include <optional>
#include <vector>

#include "infrasim/scene/roads.h"
#include "infrasim/scene/roundabout.h"

namespace infrasim {

enum class Turn { kStraight, kLeft, kRight };

/// A directed strip that vehicles follow. A lane of a road ends at the road's ends or at a
/// junction. Inside a junction a lane connects an approach to an exit.
struct Lane {
  Curve curve;
  double elevation_m = 0;
  double width_m = 3.5;
  double speed_limit_m_s = kInf;
  bool entry = false;  ///< whether new vehicles appear at the lane's start
  int approach = -1;   ///< index of the junction's approach at the lane's end; -1: none
  int junction = -1;   ///< index of the junction that contains the lane; -1: none
  int leaves = -1;     ///< index of the junction at the lane's start; -1: none
  Turn turn = Turn::kStraight;
  std::vector<int> next;  ///< indices of the lanes that begin at the lane's end
};

/// The part of a road inside a junction, by stations of its centreline.
struct JunctionCut {
  int junction = 0;
  double from = 0;
  double to = 0;
};

struct LaneNetwork {
  std::vector<Lane> lanes;
  std::vector<std::optional<JunctionCut>> cuts;  ///< part of each road inside a junction
  /// index of the junction of each approach; one approach per arm of a junction
  std::vector<int> approach_junctions;
  std::vector<JunctionConfig> junctions;
  std::vector<std::optional<Ring>> rings;  ///< ring of each junction that is a roundabout
};

/// Builds the lanes of roads and junctions. Two roads can have a junction where they cross, or
/// where one road ends on the other (a T).
/// @param centrelines centrelines of the scene's roads
/// @throws ConfigError if a junction names an unknown road, or joins roads that do not meet, lie at
///   different heights, or meet at an angle that traffic can't drive
LaneNetwork build_lane_network(const SceneConfig& scene, std::span<const Curve> centrelines);

}  // namespace infrasim
