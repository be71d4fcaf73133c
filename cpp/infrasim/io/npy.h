#pragma once

#include <cstddef>
#include <filesystem>
#include <span>
#include <vector>

namespace infrasim {

/// Writes a C-ordered (rows, columns) float64 array in NumPy's format, version 1.
/// @throws IoError
void write_npy(const std::filesystem::path& file, std::span<const double> values,
               std::size_t columns);

/// Reads the values of a C-ordered (rows, columns) array of float32 or float64, versions 1 to 3 of
/// the format.
/// @throws ConfigError if the file is not one, IoError if it can't be read
std::vector<double> read_npy(const std::filesystem::path& file, std::size_t columns);

}  // namespace infrasim
