#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <vector>

#include "infrasim/core/geometry.h"

namespace infrasim {

/// A surface from a file, in the file's own coordinates.
struct PlySurface {
  std::vector<Vec3> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

/// maximum number of triangles in a file
inline constexpr std::size_t kMostTriangles = 20'000'000;
/// maximum coordinate along an axis; map coordinates are larger and are rejected
inline constexpr double kFarthestVertex_m = 1e6;

/// Reads a .ply file, ascii or binary little-endian: x, y and z of the element `vertex`, and the
/// list `vertex_indices` (or `vertex_index`) of `face`. Polygons become fans of triangles. Other
/// elements and properties are skipped.
/// @throws IoError if the file can't be read
/// @throws ConfigError, with the line or byte of the error, for a file that is not .ply or is
///   truncated, a coordinate that is not a number within bounds, or the index of a vertex that does
///   not exist
PlySurface read_ply(const std::filesystem::path& file);

}  // namespace infrasim
