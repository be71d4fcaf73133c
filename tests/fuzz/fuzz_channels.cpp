#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "fuzz_folder.h"
#include "infrasim/config/lidar_tables.h"

// Input: the text of a channel or direction table, whole or below its header. It is read, with
// values in their ranges, or refused with a ConfigError.

namespace {

using namespace infrasim;

void read(const std::string& text) {
  static const fuzz::Folder folder;
  const auto file = folder.write("table.csv", text);
  std::vector<Channel> channels;
  if (fuzz::is_done([&] { channels = config::read_channels(file); })) {
    fuzz::require(!channels.empty());
    for (const Channel& c : channels)
      fuzz::require(std::abs(c.elevation_deg) <= 90 && std::abs(c.azimuth_offset_deg) <= 180 &&
                    c.fire_time_us >= 0 && c.fire_time_us <= 1e6);
  }
  std::vector<Vec2> directions;
  if (fuzz::is_done([&] { directions = config::read_directions(file); })) {
    fuzz::require(!directions.empty());
    for (const Vec2& d : directions) fuzz::require(std::abs(d.x) < 6.3 && std::abs(d.y) < 1.6);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string input(reinterpret_cast<const char*>(data), size);
  read(input);
  read("channel,elevation_deg,azimuth_offset_deg,fire_time_us\n" + input);
  read("azimuth_rad,elevation_rad\n" + input);
  return 0;
}
