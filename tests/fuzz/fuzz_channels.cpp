#include <algorithm>
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
  config::FiringTable table;
  if (fuzz::is_done([&] { table = config::read_firing_table(file); })) {
    fuzz::require(!table.directions.empty());
    fuzz::require(std::ranges::is_sorted(table.times_s));
    for (const Vec2& d : table.directions)
      fuzz::require(std::abs(d.x) < 6.3 && std::abs(d.y) < 1.6);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string input(reinterpret_cast<const char*>(data), size);
  read(input);
  read("channel,elevation_deg,azimuth_offset_deg,fire_time_us\n" + input);
  for (const char* header : {"azimuth_rad,elevation_rad\n", "azimuth_deg,elevation_deg,time_s\n"})
    read(header + input);
  return 0;
}
