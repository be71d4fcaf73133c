#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "fuzz_folder.h"
#include "infrasim/config/lidar_tables.h"
#include "infrasim/io/npy.h"

// Input: the bytes of a .npy file, whole or behind the start of one. They are read or refused with
// a ConfigError; what was read is written to a file that reads back to the same.

namespace {

using namespace infrasim;

void read(std::string_view bytes) {
  static const fuzz::Folder folder;
  const auto file = folder.write("table.npy", bytes);
  fuzz::is_done([&] { config::read_firing_table(file); });
  for (const std::size_t columns : {1, 2, 3}) {
    std::vector<double> values;
    if (!fuzz::is_done([&] { values = read_npy(file, columns, columns).values; })) continue;
    fuzz::require(values.size() * 4 <= bytes.size());
    write_npy(folder.path() / "again.npy", values, columns);
    const std::vector<double> again =
        read_npy(folder.path() / "again.npy", columns, columns).values;
    fuzz::require(again.size() == values.size());
    for (std::size_t i = 0; i < values.size(); ++i)
      fuzz::require(again[i] == values[i] || (std::isnan(again[i]) && std::isnan(values[i])));
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string input(reinterpret_cast<const char*>(data), size);
  read(input);
  read(std::string("\x93NUMPY\x01\x00", 8) + input);
  read(std::string("\x93NUMPY\x01\x00\x38\x00{'descr': '<f4', 'fortran_order': False, 'shape': (",
                   61) +
       input);
  return 0;
}
