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

/// Everything that follows from a scene without its mounts. It is built once and used by the rules,
/// the meshes, the evaluation region and the traffic. World frame, before the profile raises it.
struct Site {
  SceneConfig scene;
  Profile profile;
  std::vector<LanePath> lanes;               ///< from the file of `lanes`
  std::vector<Curve> centrelines;            ///< one per road
  LaneNetwork network;                       ///< lanes of the roads
  std::vector<StaticBox> boxes;              ///< buildings, gantries, trunks
  std::vector<std::vector<Box3d>> barriers;  ///< the pieces of each barrier
  std::vector<LeafVolume> leaves;            ///< hedges and crowns
  std::vector<ParkedVehicle> parked;
};

/// @throws IoError for the file of `lanes`; ConfigError if roads, junctions or roadside objects do
///   not fit each other
Site build_site(const SceneConfig& scene);

}  // namespace infrasim
