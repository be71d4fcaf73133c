#pragma once

#include <map>
#include <string>
#include <vector>

#include "infrasim/scene/overlaps.h"
#include "infrasim/scene/site.h"
#include "infrasim/scene/strips.h"

namespace infrasim {

/// Returns a text about the first overlap, with the number of all overlapping pairs.
std::string overlap_text(const std::vector<Overlap>& overlaps);

/// Finds implausible objects of a scene, one instant after the other. No objects may overlap.
/// Recorded vehicles must also be at the height of their lane, point in the direction of their
/// motion, and be longer than wide.
class TrafficChecks {
 public:
  /// @param site must outlive this object
  explicit TrafficChecks(const Site& site);

  /// Adds the states of the next instant.
  void take(const std::vector<ObjectState>& states);

  /// Returns one line of text for each kind of implausible object that was found.
  std::vector<std::string> warnings() const;

 private:
  /// The test results of one recorded vehicle.
  struct Track {
    Box3d last;  ///< box at the end of the last movement
    int movements = 0, sideways = 0;
    bool wide = false;   ///< whether the vehicle is wider than long
    int sampled = -1;    ///< instant at which the height was last tested
    double above_m = 0;  ///< height above the lane at the instant `first_off`
    /// first instant at which the vehicle was too far above or below its lane; -1: none
    int first_off = -1;
    int first_sideways = -1;
    Vec2 off_at, sideways_at;
  };

  void add_lanes();
  void test(const ObjectState& state);
  void test_motion(const Box3d& box, Track& track) const;
  void test_height(const Box3d& box, Track& track) const;

  const Site& site_;
  OverlapSearch overlaps_;
  StripIndex strips_;
  std::vector<double> levels_;  ///< z of the lane at each strip, indexed by Strip::of
  int instant_ = 0;
  std::map<int, Track> tracks_;
};

}  // namespace infrasim
