#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "infrasim/core/errors.h"
#include "infrasim/filter/background.h"
#include "infrasim/io/cloud_file.h"
#include "infrasim/io/lzf.h"

// Input: the bytes of a file. Whatever they are, each reader reads them or refuses them with a
// ConfigError; what was read is written to bytes that read back to the same.

namespace {

using namespace infrasim;

void require(bool holds) {
  if (!holds) std::abort();
}

void read_as_pcd(std::string_view bytes) {
  CloudFile cloud;
  try {
    cloud = parse_pcd(bytes, "fuzz.pcd");
  } catch (const ConfigError&) {
    return;
  }
  require(cloud.records.size() == cloud.points * cloud.record_size());
  require(cloud.xyz().size() == 3 * cloud.points);
  for (const PcdEncoding encoding : {PcdEncoding::kBinary, PcdEncoding::kBinaryCompressed}) {
    cloud.encoding = encoding;
    require(parse_pcd(pcd_bytes(cloud), "again.pcd").records == cloud.records);
  }
  // As text, NaN keeps being one but may lose its other bits: compare from the second writing on.
  cloud.encoding = PcdEncoding::kAscii;
  const CloudFile text = parse_pcd(pcd_bytes(cloud), "text.pcd");
  require(parse_pcd(pcd_bytes(text), "again.pcd").records == text.records);
}

void read_as_bin(std::string_view bytes) {
  try {
    require(parse_bin(bytes, "fuzz.bin").points * 16 == bytes.size());
  } catch (const ConfigError&) {
    require(bytes.size() % 16 != 0);
  }
}

void read_as_background(std::string_view bytes) {
  try {
    const BackgroundModel model = background_from_bytes(bytes, "fuzz");
    const auto again = background_from_bytes(background_to_bytes(model), "again");
    require(again.range_m == model.range_m);
  } catch (const ConfigError&) {
  }
}

void unpack(std::string_view bytes) {
  constexpr std::size_t kSize = 300;
  const auto unpacked = lzf_decompress(bytes, kSize);
  require(!unpacked || unpacked->size() == kSize);
  require(lzf_decompress(lzf_compress(bytes), bytes.size()) == bytes);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  read_as_pcd(bytes);
  read_as_bin(bytes);
  read_as_background(bytes);
  unpack(bytes);
  return 0;
}
