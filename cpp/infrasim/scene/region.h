#pragma once

#include <string>
#include <vector>

#include "infrasim/core/classes.h"
#include "infrasim/scene/lane_part.h"
#include "infrasim/scene/site.h"

namespace infrasim {

/// width of the strip beside a carriageway in which pedestrians and cyclists are also evaluated
inline constexpr double kFootways_m = 6;

/// The region in which objects are evaluated.
///
/// If the scene has roads, the region is the carriageway of each road from -half length to +half
/// length around the sensor's foot, which is the point vertically below the sensor. The station s
/// is 0 at the foot and grows in the sensor's viewing direction, or in the direction of traffic on
/// a roundabout's ring. If the scene has a lane file, the region is the parts of lanes that are at
/// most the half length away from the foot. Each part is a separate road in the direction of
/// traffic.
///
/// For pedestrians and cyclists the region is kFootways_m wider on each side. If the scene has
/// `regions`, the evaluation region is only the part inside these outlines.
class EvaluationRegion {
 public:
  /// @param mount mount at whose foot the region is centred
  /// @throws ConfigError if no lane of the lane file is near, if two parts have the same name, or
  ///   if no road or lane overlaps with `regions`
  EvaluationRegion(const Site& site, const MountConfig& mount);

  /// Returns whether an object is in the region.
  /// @param point centre of an object of the class, world frame
  bool contains(Vec2 point, Class object_class) const;

  /// Returns a table with the columns road,s,x,y,z,heading,half_width in 1 m steps along roads and
  /// lanes, regardless of `regions`; world frame, metres, radians.
  std::string roads_csv() const;
  /// Returns a table with the columns region,x,y: corners in order, world frame, metres; empty
  /// without `regions`.
  std::string regions_csv() const;

 private:
  struct RoadPart {
    std::string name;
    Curve along;  ///< centreline in the direction of increasing s
    double foot;  ///< station of the sensor's foot on `along`
    double elevation;
    double half_width;
    CurveGrid grid;  ///< grid of the part of `along` in the region
  };
  void add_road(const std::string& name, Curve along, double foot, double elevation,
                double half_width);
  void check_names(const SceneConfig& scene) const;
  void check_outlines(const SceneConfig& scene) const;
  bool in_outlines(Vec2 point) const;
  /// Passes the rows of roads_csv to `take`, road by road, in order of increasing s.
  template <class Take>
  void for_each_row(const Take& take) const;

  std::vector<RoadPart> roads_;
  std::vector<LanePart> parts_;
  std::vector<RegionConfig> outlines_;  ///< if empty, `regions` does not limit the region
  double half_length_;
  Profile profile_;
};

}  // namespace infrasim
