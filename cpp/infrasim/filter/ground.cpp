#include "infrasim/filter/ground.h"

#include <pcl/console/print.h>
#include <pcl/point_types.h>
#include <pcl/segmentation/sac_segmentation.h>

#include <stdexcept>

#include "infrasim/filter/points.h"

namespace infrasim {

namespace {

/// n . p + d = 0 with a unit normal n; a null normal means none was found.
struct Plane {
  Vec3 normal;
  double d = 0;
};

/// At most this many points take part in the search: evenly chosen ones give the same plane.
constexpr std::size_t kFitPoints = 20000;

pcl::PointCloud<pcl::PointXYZ>::Ptr fit_points(std::span<const float> xyz) {
  auto cloud = pcl::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
  const std::size_t step = 1 + point_count(xyz) / kFitPoints;
  for (std::size_t i = 0; i < point_count(xyz); i += step)
    if (is_finite(point_at(xyz, i))) cloud->push_back({xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]});
  return cloud;
}

Plane find_plane(std::span<const float> xyz, const GroundPlane& ground) {
  // PCL prints when it finds none, which is no fault here; its level of printing is a global.
  static const bool quiet = (pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS), true);
  static_cast<void>(quiet);
  const auto cloud = fit_points(xyz);
  if (cloud->size() < 3) return {};
  pcl::SACSegmentation<pcl::PointXYZ> search(/*random=*/false);
  search.setModelType(pcl::SACMODEL_PERPENDICULAR_PLANE);
  search.setMethodType(pcl::SAC_RANSAC);
  search.setAxis(Eigen::Vector3f::UnitZ());
  search.setEpsAngle(rad(ground.max_tilt_deg));
  search.setDistanceThreshold(ground.distance_m);
  search.setMaxIterations(1000);
  search.setOptimizeCoefficients(true);
  search.setInputCloud(cloud);
  pcl::PointIndices inliers;
  pcl::ModelCoefficients c;
  search.segment(inliers, c);
  if (inliers.indices.empty() || c.values.size() != 4) return {};
  return {{c.values[0], c.values[1], c.values[2]}, c.values[3]};
}

}  // namespace

std::vector<int> keep(std::span<const float> xyz, const GroundHeight& ground) {
  if (!std::isfinite(ground.z_m)) throw std::invalid_argument("ground_height: z must be a number");
  return keep_if(xyz, [&](Vec3 p) { return p.z > ground.z_m; });
}

std::vector<int> keep(std::span<const float> xyz, const GroundPlane& ground) {
  if (!(ground.distance_m > 0 && ground.max_tilt_deg > 0 && ground.max_tilt_deg < 90))
    throw std::invalid_argument(
        "ground_plane: the distance must be positive and the tilt within (0, 90) degrees");
  const Plane plane = find_plane(xyz, ground);
  if (norm(plane.normal) == 0) return keep_if(xyz, [](Vec3) { return true; });
  return keep_if(
      xyz, [&](Vec3 p) { return std::abs(dot(plane.normal, p) + plane.d) > ground.distance_m; });
}

}  // namespace infrasim
