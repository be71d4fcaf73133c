#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "infrasim/core/rays.h"

namespace infrasim {

/// The light that the detector receives from one ray.
struct Echo {
  float range;             ///< range in metres; +inf if there is no echo
  std::int32_t object;     ///< index of the moving body; -1 for the background
  std::uint16_t class_id;  ///< class of the background
  float reflectance;       ///< reflectance of the surface, reduced by the window panes on the path
  float gain;  ///< power relative to a Lambertian surface of this reflectance at normal incidence
};

/// The echo of each ray, one column per attribute.
struct EchoBatch {
  std::vector<float> range;
  std::vector<std::int32_t> object;
  std::vector<std::uint16_t> class_id;
  std::vector<float> reflectance;
  std::vector<float> gain;

  std::size_t size() const { return range.size(); }
  void resize(std::size_t n) {
    range.resize(n);
    object.resize(n);
    class_id.resize(n);
    reflectance.resize(n);
    gain.resize(n);
  }
  Echo at(std::size_t i) const {
    return {range[i], object[i], class_id[i], reflectance[i], gain[i]};
  }
  void set(std::size_t i, const Echo& echo) {
    range[i] = echo.range;
    object[i] = echo.object;
    class_id[i] = echo.class_id;
    reflectance[i] = echo.reflectance;
    gain[i] = echo.gain;
  }
  /// Makes echoes of Lambertian surfaces from hits. The function moves the columns of the hits,
  /// except for the positions. The caller must then set the reflectance.
  void take(HitBatch& hits) {
    range.swap(hits.range);
    object.swap(hits.object);
    class_id.swap(hits.class_id);
    gain.swap(hits.cos_incidence);
    reflectance.resize(range.size());
  }
};

}  // namespace infrasim
