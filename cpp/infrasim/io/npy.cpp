#include "infrasim/io/npy.h"

#include <cstring>
#include <string>
#include <vector>

#include "infrasim/io/atomic_file.h"

namespace infrasim {

void write_npy(const std::filesystem::path& file, std::span<const double> values,
               std::size_t columns) {
  std::string header = "{'descr': '<f8', 'fortran_order': False, 'shape': (" +
                       std::to_string(values.size() / columns) + ", " + std::to_string(columns) +
                       "), }";
  header.append(63 - (10 + header.size()) % 64, ' ');
  header += '\n';
  std::string bytes("\x93NUMPY\x01\x00", 8);
  bytes += static_cast<char>(header.size() % 256);
  bytes += static_cast<char>(header.size() / 256);
  bytes += header;
  const std::size_t start = bytes.size();
  bytes.resize(start + values.size_bytes());
  std::memcpy(bytes.data() + start, values.data(), values.size_bytes());
  write_file_atomically(file, bytes);
}

}  // namespace infrasim
