#pragma once

#include <string>
#include <vector>

#include "infrasim/core/classes.h"
#include "infrasim/scene/static_world.h"

namespace infrasim {

inline constexpr double kFootways_m = 6;  ///< beside the carriageway, where people count too

/// The evaluation region: along each road from -half length to +half length around the sensor's
/// foot, within the carriageway; for people kFootways_m beyond it on both sides. Stations s are 0
/// at the foot and grow along the sensor's view.
class EvaluationRegion {
 public:
  explicit EvaluationRegion(const SceneConfig& scene);

  /// @param point world frame, the centre of what is of the class
  bool contains(Vec2 point, Class object_class) const;

  /// Columns road,s,x,y,z,heading,half_width at 1 m steps over the region; world frame, metres,
  /// radians.
  std::string roads_csv() const;

 private:
  struct Road {
    std::string name;
    Curve along;  ///< runs with the view
    double foot;  ///< station of the sensor's foot on `along`
    double elevation;
    double half_width;
  };
  std::vector<Road> roads_;
  double half_length_;
};

}  // namespace infrasim
