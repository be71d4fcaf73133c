#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace infrasim {

/// Points of one LiDAR in one frame, one column per attribute; all columns have length size().
struct PointCloud {
  std::vector<float> xyz;               ///< 3 * size(), row-major, metres, levelled LiDAR frame
  std::vector<float> intensity;         ///< intensity of the return, [0, 1]
  std::vector<float> time;              ///< seconds since the start of the frame
  std::vector<std::uint16_t> ring;      ///< index of the laser, 0 at the lowest elevation
  std::vector<std::uint16_t> class_id;  ///< class of the point, a value of Class
  std::vector<std::int32_t> object_id;  ///< id of the object; -1 for background
  /// 1 for the second point of a ray, otherwise 0. The first point is the strongest echo.
  std::vector<std::uint8_t> echo;

  std::size_t size() const { return intensity.size(); }

  /// Calls use(column, number of values per point) for each column, where `column` is a pointer to
  /// a data member of PointCloud.
  template <class Use>
  static void for_each_column(const Use& use) {
    use(&PointCloud::xyz, std::size_t{3});
    use(&PointCloud::intensity, std::size_t{1});
    use(&PointCloud::time, std::size_t{1});
    use(&PointCloud::ring, std::size_t{1});
    use(&PointCloud::class_id, std::size_t{1});
    use(&PointCloud::object_id, std::size_t{1});
    use(&PointCloud::echo, std::size_t{1});
  }

  void resize(std::size_t n) {
    for_each_column([&](auto column, std::size_t values) { (this->*column).resize(values * n); });
  }
};

}  // namespace infrasim
