#include <pcl/console/print.h>
#include <pcl/point_types.h>
#include <pcl/segmentation/sac_segmentation.h>

#include <stdexcept>

#include "infrasim/filter/filter.h"
#include "infrasim/filter/points.h"

namespace infrasim {

namespace {

/// The plane n . p + d = 0 with a unit normal n. If `points` is 0, no plane was found.
struct Plane {
  Vec3 normal;
  double d = 0;
  std::size_t points = 0;  ///< number of searched points on the plane
};

/// Maximum number of points in the search. If there are more, evenly chosen points are used, which
/// give the same plane as all points.
constexpr std::size_t kFitPoints = 20000;
/// Maximum number of planes that the search tries.
constexpr int kMostPlanes = 8;
constexpr double kHeightTolerance_m = 0.5;
/// A plane within kClose_m of the expected height is the ground, even if another plane within
/// kHeightTolerance_m has more points. The ground must have at least 1 / kFewer of the points of
/// the other plane.
constexpr double kClose_m = 0.15;
constexpr std::size_t kFewer = 10;

pcl::PointCloud<pcl::PointXYZ>::Ptr fit_points(std::span<const float> xyz) {
  auto cloud = pcl::make_shared<pcl::PointCloud<pcl::PointXYZ>>();
  const std::size_t step = 1 + point_count(xyz) / kFitPoints;
  for (std::size_t i = 0; i < point_count(xyz); i += step)
    if (is_return(point_at(xyz, i))) cloud->push_back({xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]});
  return cloud;
}

/// Returns the largest nearly level plane of the points.
Plane largest_plane(const pcl::PointCloud<pcl::PointXYZ>::Ptr& cloud, const GroundPlane& ground) {
  // PCL prints a message if it finds no plane, which is not an error here. PCL's verbosity is a
  // global variable.
  static const bool quiet = (pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS), true);
  static_cast<void>(quiet);
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
  return {{c.values[0], c.values[1], c.values[2]}, c.values[3], inliers.indices.size()};
}

double distance(const Plane& plane, Vec3 p) { return std::abs(dot(plane.normal, p) + plane.d); }

/// Finds the ground plane. Planes at other heights, such as a field beside an embankment, are
/// removed before the next search.
Plane find_plane(std::span<const float> xyz, const GroundPlane& ground) {
  const auto cloud = fit_points(xyz);
  Plane best;
  for (int i = 0; i < kMostPlanes; ++i) {
    const Plane plane = largest_plane(cloud, ground);
    if (plane.points == 0 || ground.sensor_height_m == 0) return i == 0 ? plane : best;
    const double off = std::abs(plane.d / plane.normal.z - ground.sensor_height_m);
    if (off <= kClose_m && kFewer * plane.points >= best.points) return plane;
    if (off <= kHeightTolerance_m && best.points == 0) best = plane;
    std::erase_if(cloud->points, [&](const pcl::PointXYZ& p) {
      return distance(plane, {p.x, p.y, p.z}) <= ground.distance_m;
    });
    cloud->width = static_cast<std::uint32_t>(cloud->points.size());
  }
  return best;
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
  if (!(ground.sensor_height_m >= 0))
    throw std::invalid_argument("ground_plane: the sensor's height must not be negative");
  const Plane plane = find_plane(xyz, ground);
  if (plane.points == 0) return keep_if(xyz, [](Vec3) { return true; });
  return keep_if(xyz, [&](Vec3 p) { return distance(plane, p) > ground.distance_m; });
}

}  // namespace infrasim
