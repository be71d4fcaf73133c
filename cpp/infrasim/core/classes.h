#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

namespace infrasim {

/// Class of a point: a material for the background, an object class for objects.
enum class Class : std::uint16_t {
  kRoad = 0,
  kSidewalk = 1,
  kTerrain = 2,
  kStructure = 3,
  kVegetation = 4,
  kRecorded = 5,  ///< background taken from a recording, of unknown material
  kCar = 10,
  kVan = 11,
  kTruck = 12,
  kBus = 13,
  kMotorcycle = 14,
  kPedestrian = 15,
  kCyclist = 16,
};

/// Mean and standard deviation of a size, metres.
struct Spread {
  double mean;
  double std;
};

/// One row of the table of object classes.
struct ObjectClass {
  Class id;
  std::string_view name;  ///< as in KITTI's label files
  Spread length_m, width_m, height_m;
  bool vehicle;  ///< whether the class belongs to the group `vehicle`
};

/// Sizes come from the blueprints of CARLA 0.9.15. Sizes of buses and pedestrians come from the
/// nuScenes anchors, whose standard deviations are unpublished and are assumed to be 5 % of the
/// mean.
inline constexpr std::array<ObjectClass, 7> kObjectClasses{{
    {Class::kCar, "Car", {4.53, 0.71}, {1.95, 0.16}, {1.57, 0.17}, true},
    {Class::kVan, "Van", {5.30, 0.85}, {2.05, 0.21}, {2.25, 0.25}, true},
    {Class::kTruck, "Truck", {6.97, 1.30}, {2.70, 0.21}, {2.96, 0.71}, true},
    {Class::kBus, "Bus", {10.5, 0.52}, {2.94, 0.10}, {3.47, 0.17}, true},
    {Class::kMotorcycle, "Motorcycle", {2.10, 0.10}, {0.82, 0.04}, {1.57, 0.08}, true},
    {Class::kPedestrian, "Pedestrian", {0.73, 0.04}, {0.67, 0.03}, {1.77, 0.09}, false},
    {Class::kCyclist, "Cyclist", {1.67, 0.08}, {0.70, 0.03}, {1.67, 0.08}, false},
}};

inline const ObjectClass* find_class(std::string_view name) {
  for (const ObjectClass& row : kObjectClasses)
    if (row.name == name) return &row;
  return nullptr;
}

inline const ObjectClass& class_of(Class id) {
  for (const ObjectClass& row : kObjectClasses)
    if (row.id == id) return row;
  return kObjectClasses.front();
}

}  // namespace infrasim
