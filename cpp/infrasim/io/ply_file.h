#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "infrasim/core/geometry.h"

namespace infrasim {

/// A surface as it stands in a file, in the file's own coordinates.
struct PlySurface {
  std::vector<Vec3> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

inline constexpr std::size_t kMostTriangles = 20'000'000;  ///< of a file
inline constexpr double kFarthestVertex_m = 1e6;           ///< along an axis: no map coordinates

/// Reads a .ply file, ascii or binary little-endian: x, y and z of the element `vertex`, and the
/// list `vertex_indices` (or `vertex_index`) of `face`, whose polygons become fans of triangles.
/// Other elements and properties are read over.
/// @throws IoError if it can't be read; ConfigError, with its line or byte, if it is no such file
/// or is cut, for a coordinate that is no number in reach, and for a corner that is no vertex
PlySurface read_ply(const std::filesystem::path& file);

}  // namespace infrasim
