#include <cstddef>
#include <cstdint>
#include <string>

#include "fuzz_folder.h"
#include "infrasim/pipeline/static_layer_file.h"

// Input: the bytes of a static layer, whole or behind its first line. They are refused with a
// ConfigError, or are what the layer that was read is written as.

namespace {

using namespace infrasim;

void read(const std::string& bytes) {
  StaticLayerFile file;
  if (!fuzz::is_done([&] { file = static_layer_from_bytes(bytes, "a.layer"); })) return;
  fuzz::require(static_layer_to_bytes(file.origin, file.units) == bytes);
  for (const StaticHits& unit : file.units) {
    fuzz::require(unit.range_m.size() == unit.rays());
    for (const float range : unit.range_m) fuzz::require(range >= 0);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string input(reinterpret_cast<const char*>(data), size);
  read(input);
  read("infrasim-static-layer 2\n" + input);
  return 0;
}
