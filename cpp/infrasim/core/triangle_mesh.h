#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace infrasim {

/// A triangle mesh with a class per triangle.
struct TriangleMesh {
  std::vector<std::array<float, 3>> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<std::uint16_t>
      class_id;  ///< one per triangle; if empty, all triangles have the class of the object
};

}  // namespace infrasim
