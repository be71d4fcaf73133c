#pragma once

#include <string>
#include <vector>

#include "infrasim/core/classes.h"
#include "infrasim/scene/lane_part.h"
#include "infrasim/scene/site.h"

namespace infrasim {

inline constexpr double kFootways_m = 6;  ///< beside a carriageway, where people count too

/// The evaluation region. With lanes of a file: what of them lies within the half length of the
/// sensor's foot, each stretch a road of its own that runs with the traffic. With roads: along each
/// from -half length to +half length around the foot, within the carriageway; stations s are 0 at
/// the foot and grow along the sensor's view, of a roundabout's ring along its traffic. For people
/// kFootways_m more on both sides. With `regions`, only what lies in one of them.
class EvaluationRegion {
 public:
  /// @param mount whose foot the region lies around
  /// @throws ConfigError if no lane is near, or none of the roads or lanes meets `regions`
  EvaluationRegion(const Site& site, const MountConfig& mount);

  /// @param point world frame, the centre of what is of the class
  bool contains(Vec2 point, Class object_class) const;

  /// Columns road,s,x,y,z,heading,half_width at 1 m steps along roads and lanes, whatever
  /// `regions` leave of them; world frame, metres, radians.
  std::string roads_csv() const;
  /// Columns region,x,y: corners in order, world frame, metres; empty without `regions`.
  std::string regions_csv() const;

 private:
  struct RoadPart {
    std::string name;
    Curve along;  ///< runs with the view
    double foot;  ///< station of the sensor's foot on `along`
    double elevation;
    double half_width;
  };
  void check_names(const SceneConfig& scene) const;
  void check_outlines(const SceneConfig& scene) const;
  bool in_outlines(Vec2 point) const;
  /// One after the other: road by road, s rising.
  template <class Take>
  void for_each_row(const Take& take) const;

  std::vector<RoadPart> roads_;
  std::vector<LanePart> parts_;
  std::vector<RegionConfig> outlines_;  ///< none: everywhere
  double half_length_;
  Profile profile_;
};

}  // namespace infrasim
