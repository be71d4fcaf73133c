#pragma once

#include <vector>

#include "infrasim/config/scene_config.h"
#include "infrasim/scene/lane_file.h"
#include "infrasim/scene/lane_network.h"
#include "infrasim/scene/parked.h"
#include "infrasim/scene/profile.h"
#include "infrasim/scene/static_boxes.h"
#include "infrasim/scene/vegetation.h"

namespace infrasim {

/// The roads, lanes and static objects of a scene. A site is built once. The checks, the meshes,
/// the evaluation region and the traffic use it. Positions are in the world frame, before the
/// profile raises them.
struct Site {
  SceneConfig scene;
  Profile profile;
  std::vector<LanePath> lanes;               ///< lanes from the file that the key `lanes` names
  std::vector<Curve> centrelines;            ///< centreline of each road
  LaneNetwork network;                       ///< lanes of the roads
  std::vector<StaticBox> boxes;              ///< buildings, gantries, trunks
  std::vector<std::vector<Box3d>> barriers;  ///< the pieces of each barrier
  std::vector<LeafVolume> leaves;            ///< hedges and crowns
  std::vector<ParkedVehicle> parked;
};

/// @throws IoError if the file of `lanes` can't be read, ConfigError if roads, junctions or
///   roadside objects contradict each other
Site build_site(const SceneConfig& scene);

}  // namespace infrasim
