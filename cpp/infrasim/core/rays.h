#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace infrasim {

/// Rays from the origin of the levelled frame, group by group, one column per attribute.
struct RayBatch {
  std::vector<float> dx, dy, dz;  ///< unit direction, levelled frame
  std::vector<float> time;        ///< seconds since the start of the frame
  std::vector<std::uint16_t> ring;
  float max_range = 0;  ///< metres; hits beyond are misses

  std::size_t size() const { return time.size(); }
  void resize(std::size_t n) {
    for (auto* column : {&dx, &dy, &dz, &time}) column->resize(n);
    ring.resize(n);
  }
};

/// Nearest hit of each ray.
struct HitBatch {
  std::vector<float> range;             ///< metres; +inf: nothing hit
  std::vector<float> cos_incidence;     ///< between beam and surface normal, [0, 1]
  std::vector<std::int32_t> object;     ///< index of the moving body; -1: background
  std::vector<std::uint16_t> class_id;  ///< of the background where object is -1

  std::size_t size() const { return range.size(); }
  void resize(std::size_t n) {
    range.resize(n);
    cos_incidence.resize(n);
    object.resize(n);
    class_id.resize(n);
  }
};

}  // namespace infrasim
