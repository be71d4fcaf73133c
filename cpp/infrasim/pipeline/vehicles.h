#pragma once

#include <vector>

#include "infrasim/pipeline/world.h"

namespace infrasim {

/// The objects of one frame that are within range, by id, with one column per attribute. The
/// attributes do not depend on the LiDAR.
struct FrameVehicles {
  std::vector<MovingObject> moving;  ///< world frame
  std::vector<MovingBody> bodies;    ///< levelled frame
  std::vector<Box3d> boxes;          ///< at mid-frame, levelled frame
  std::vector<float> reflectance;    ///< reflectance of the paint
  std::vector<bool> on_lane;         ///< simulated traffic, which stands on the road
  std::vector<double> visibility;    ///< visible share; -1 outside the region

  std::size_t size() const { return moving.size(); }
};

/// Sets the objects of frame k in the raycaster. Leaves out objects that stay farther than `reach`
/// metres (horizontal) from the sensor during the whole frame.
FrameVehicles set_vehicles(const World& world, int k, double period_s, double reach,
                           Raycaster& raycaster);

/// Freezes the raycaster's objects at a share of the frame.
void freeze_vehicles(const World& world, const FrameVehicles& vehicles, double period_s,
                     double share, Raycaster& raycaster);

}  // namespace infrasim
