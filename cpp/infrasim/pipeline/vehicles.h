#pragma once

#include <vector>

#include "infrasim/pipeline/world.h"

namespace infrasim {

/// The objects of one frame that are within range, by id, one column per attribute. It holds only
/// attributes that do not depend on the LiDAR.
struct FrameVehicles {
  std::vector<MovingObject> moving;  ///< world frame
  std::vector<MovingBody> bodies;    ///< levelled frame, as the boxes
  std::vector<Box3d> boxes;          ///< at mid-frame
  std::vector<float> reflectance;    ///< reflectance of the paint
  std::vector<bool> on_lane;         ///< simulated traffic: its ground is the road, without a cast
  std::vector<double> visibility;    ///< visible share; -1 outside the region

  std::size_t size() const { return moving.size(); }
};

/// Gives the raycaster the objects of frame k that can be within `reach` metres of the sensor at
/// some time, with any part.
FrameVehicles set_vehicles(const World& world, int k, double reach, Raycaster& raycaster);

/// Freezes the raycaster's objects at a share of the frame.
void freeze_vehicles(const World& world, const FrameVehicles& vehicles, double share,
                     Raycaster& raycaster);

}  // namespace infrasim
