#pragma once

#include <cstddef>
#include <filesystem>
#include <span>

namespace infrasim {

/// Writes a C-ordered (rows, columns) float64 array in NumPy's format, version 1.
/// @throws IoError
void write_npy(const std::filesystem::path& file, std::span<const double> values,
               std::size_t columns);

}  // namespace infrasim
