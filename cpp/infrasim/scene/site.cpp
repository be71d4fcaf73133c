#include "infrasim/scene/site.h"

#include <utility>

namespace infrasim {

Site build_site(const SceneConfig& scene) {
  std::vector<LanePath> lanes = lanes_of(scene);
  std::vector<Curve> lines = centrelines(scene);
  LaneNetwork network = build_lane_network(scene, lines);
  std::vector<std::vector<Box3d>> barriers;
  for (const BarrierConfig& barrier : scene.barriers)
    barriers.push_back(
        barrier_pieces(road_named(scene, lines, barrier.road, barrier.place), barrier));
  std::vector<StaticBox> boxes = static_boxes(scene, lines);
  std::vector<LeafVolume> leaves = leaf_volumes(scene, lines);
  std::vector<ParkedVehicle> parked = parked_vehicles(scene, lines);
  return {scene,
          Profile(scene),
          std::move(lanes),
          std::move(lines),
          std::move(network),
          std::move(boxes),
          std::move(barriers),
          std::move(leaves),
          std::move(parked)};
}

}  // namespace infrasim
