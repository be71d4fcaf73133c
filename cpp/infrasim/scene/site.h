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

/// What follows from a scene alone, whatever its mounts are: built once, and read by the rules, the
/// meshes, the evaluation region and the traffic. World frame, before the profile lifts it.
struct Site {
  SceneConfig scene;
  Profile profile;
  std::vector<LanePath> lanes;               ///< of the file of `lanes`
  std::vector<Curve> centrelines;            ///< of each road
  LaneNetwork network;                       ///< of the roads
  std::vector<StaticBox> boxes;              ///< buildings, gantries, trunks
  std::vector<std::vector<Box3d>> barriers;  ///< of each barrier, its pieces
  std::vector<LeafVolume> leaves;            ///< hedges and crowns
  std::vector<ParkedVehicle> parked;
};

/// @throws IoError for the file of `lanes`; ConfigError for roads, junctions or what stands along
/// roads, if they do not fit each other
Site build_site(const SceneConfig& scene);

}  // namespace infrasim
