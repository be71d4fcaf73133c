#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace infrasim {

/// Rays from the origin of the levelled frame. Each attribute is a column.
struct RayBatch {
  /// index of each ray among the rays of a scan pattern from which the batch was made, in ascending
  /// order; empty if the rays are not from a scan pattern
  std::vector<std::uint32_t> number;
  std::vector<float> dx, dy, dz;  ///< unit direction, levelled frame
  std::vector<float> time;        ///< seconds since the start of the frame
  std::vector<std::uint16_t> ring;
  /// minimum range of each ray, metres; if the vector is empty, the minimum is 0
  std::vector<float> near;
  float max_range = 0;  ///< maximum range, metres; farther hits count as misses

  std::size_t size() const { return time.size(); }
  float near_range(std::size_t i) const { return near.empty() ? 0 : near[i]; }
  void resize(std::size_t n) {
    for (auto* column : {&dx, &dy, &dz, &time}) column->resize(n);
    ring.resize(n);
  }
  /// Copies `n` rays from row `from` to the lower row `to`.
  void move_rows(std::size_t from, std::size_t to, std::size_t n) {
    for (auto* column : {&dx, &dy, &dz, &time}) std::copy_n(&(*column)[from], n, &(*column)[to]);
    std::copy_n(&ring[from], n, &ring[to]);
  }
};

/// Position at which a ray hits a moving body, and the surface normal there.
struct BodyPlace {
  std::array<float, 3> at;      ///< position in the body's unit box, [-0.5, 0.5], x forward
  std::array<float, 3> normal;  ///< unit vector in the body's frame, pointing inwards or outwards
};

/// Nearest hit of a ray.
struct Hit {
  float range;
  float cos_incidence;
  std::int32_t object;
  std::uint16_t class_id;
  const BodyPlace& place;
};

/// Nearest hit of each ray.
struct HitBatch {
  std::vector<float> range;  ///< range of the hit, metres; +inf if nothing was hit
  /// cosine of the angle between ray and surface normal, [0, 1]
  std::vector<float> cos_incidence;
  std::vector<std::int32_t> object;  ///< index of the moving body; -1 for background or no hit
  /// class of the background that the ray would hit without moving bodies; 0 if there is none
  std::vector<std::uint16_t> class_id;
  std::vector<BodyPlace> place;  ///< position on a moving body; filled together with cos_incidence

  std::size_t size() const { return range.size(); }
  Hit at(std::size_t i) const {
    return {range[i], cos_incidence[i], object[i], class_id[i], place[i]};
  }
  void resize(std::size_t n) {
    range.resize(n);
    cos_incidence.resize(n);
    object.resize(n);
    class_id.resize(n);
    place.resize(n);
  }
  /// Copies `n` hits from row `from` to the lower row `to`.
  void move_rows(std::size_t from, std::size_t to, std::size_t n) {
    const auto move = [&](auto& column) { std::copy_n(&column[from], n, &column[to]); };
    move(range);
    move(cos_incidence);
    move(object);
    move(class_id);
    move(place);
  }
};

}  // namespace infrasim
