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

struct NpyTable {
  std::vector<double> values;  ///< values of the array, row by row
  std::size_t columns = 0;
};

/// Reads a C-ordered (rows, columns) array of float32 or float64, versions 1 to 3 of the format.
/// @param least, most minimum and maximum number of columns
/// @throws ConfigError if the file is not such an array, IoError if it can't be read
NpyTable read_npy(const std::filesystem::path& file, std::size_t least, std::size_t most);

}  // namespace infrasim
