#pragma once

#include <string>
#include <vector>

#include "infrasim/core/classes.h"
#include "infrasim/scene/lane_part.h"
#include "infrasim/scene/site.h"

namespace infrasim {

/// beside a carriageway; pedestrians and cyclists count there too
inline constexpr double kFootways_m = 6;

/// The evaluation region. With a lane file, it is the parts of the lanes within the half length of
/// the sensor's foot, each a road of its own in the direction of traffic. With roads, it runs along
/// each road from -half length to +half length around the foot, within the carriageway. Stations s
/// are 0 at the foot and grow along the sensor's view, or along the traffic on a roundabout's ring.
/// For pedestrians and cyclists the region is kFootways_m wider on both sides. With `regions`, only
/// the parts inside one of them count.
class EvaluationRegion {
 public:
  /// @param mount the region lies around its foot
  /// @throws ConfigError if no lane is near, or no road or lane overlaps with `regions`
  EvaluationRegion(const Site& site, const MountConfig& mount);

  /// @param point centre of an object of the class, world frame
  bool contains(Vec2 point, Class object_class) const;

  /// Columns road,s,x,y,z,heading,half_width in 1 m steps along roads and lanes, regardless of
  /// `regions`; world frame, metres, radians.
  std::string roads_csv() const;
  /// Columns region,x,y: corners in order, world frame, metres; empty without `regions`.
  std::string regions_csv() const;

 private:
  struct RoadPart {
    std::string name;
    Curve along;  ///< in the direction of the view
    double foot;  ///< station of the sensor's foot on `along`
    double elevation;
    double half_width;
  };
  void check_names(const SceneConfig& scene) const;
  void check_outlines(const SceneConfig& scene) const;
  bool in_outlines(Vec2 point) const;
  /// Visits the rows, road by road, with increasing s.
  template <class Take>
  void for_each_row(const Take& take) const;

  std::vector<RoadPart> roads_;
  std::vector<LanePart> parts_;
  std::vector<RegionConfig> outlines_;  ///< empty: the region is not limited
  double half_length_;
  Profile profile_;
};

}  // namespace infrasim
