#pragma once

#include <vector>

#include "infrasim/pipeline/world.h"

namespace infrasim {

/// The vehicles of one frame that LiDARs can reach, by id, one column per attribute; without what
/// depends on the LiDAR.
struct FrameVehicles {
  std::vector<MovingObject> moving;  ///< world frame
  std::vector<MovingBody> bodies;    ///< levelled frame, as the boxes
  std::vector<Box3d> boxes;          ///< at mid-frame
  std::vector<float> reflectance;    ///< of the paint
  std::vector<bool> on_lane;         ///< simulated traffic: road is below it, not what a cast finds
  std::vector<double> visibility;    ///< share that nothing hides; -1 outside the region

  std::size_t size() const { return moving.size(); }
};

/// Gives the raycaster the vehicles of frame k of which some part can be within `reach` metres of
/// the sensor at some time.
FrameVehicles set_vehicles(const World& world, int k, double reach, Raycaster& raycaster);

/// Makes the raycaster's vehicles stand still as they are at a share of the frame.
void freeze_vehicles(const World& world, const FrameVehicles& vehicles, double share,
                     Raycaster& raycaster);

}  // namespace infrasim
