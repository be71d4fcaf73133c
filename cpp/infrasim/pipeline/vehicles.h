#pragma once

#include <vector>

#include "infrasim/pipeline/world.h"

namespace infrasim {

/// The objects of one frame that are within range of the sensor, ordered by id, with one column per
/// attribute. The attributes do not depend on the LiDAR.
struct FrameVehicles {
  std::vector<MovingObject> moving;  ///< objects with their motion, world frame
  std::vector<MovingBody> bodies;    ///< bodies for the raycaster, levelled frame
  std::vector<Box3d> boxes;          ///< boxes at mid-frame, levelled frame
  std::vector<float> reflectance;    ///< reflectance of the paint
  /// whether the object is part of the simulated traffic, and thus on a lane
  std::vector<bool> on_lane;
  std::vector<double> visibility;  ///< visible share; -1 outside the evaluation region

  std::size_t size() const { return moving.size(); }
};

/// Sets the objects of frame k in the raycaster. Omits objects whose horizontal distance from the
/// sensor exceeds `reach` metres during the whole frame.
FrameVehicles set_vehicles(const World& world, int k, double period_s, double reach,
                           Raycaster& raycaster);

/// Sets the raycaster's objects to their positions at one instant, given as a share of the frame.
void freeze_vehicles(const World& world, const FrameVehicles& vehicles, double period_s,
                     double share, Raycaster& raycaster);

}  // namespace infrasim
