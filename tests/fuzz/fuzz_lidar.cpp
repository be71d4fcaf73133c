#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "fuzz_folder.h"
#include "infrasim/config/lidar_config.h"
#include "infrasim/sensor/pattern_table.h"

// Input: the text of a LiDAR file, whole or below a name and a price. It is read or refused with a
// ConfigError (an IoError for a file that it names), and few rays are traced; what was read dumps
// to a text that reads back to the same dump.

namespace {

using namespace infrasim;

constexpr double kFewRays = 3e5;  // a second: more take too long to trace

std::optional<std::string> dump(const std::filesystem::path& file, const std::string& preset) {
  std::optional<std::string> text;
  try {
    fuzz::is_done([&] {
      const LidarConfig lidar = read_lidar(file, preset);
      double rays = 0;
      for (const LidarUnit& unit : lidar.units) rays += rays_per_s(unit.pattern);
      if (rays < kFewRays) fields_of_view(lidar);
      text = dump_lidar(lidar);
    });
  } catch (const IoError&) {
  }
  return text;
}

void read(const std::string& text) {
  static const fuzz::Folder folder;
  [[maybe_unused]] static const bool linked =
      (std::filesystem::create_directory_symlink(
           std::filesystem::path(INFRASIM_SOURCE_DIR) / "configs" / "lidars" / "channels",
           folder.path() / "channels"),
       true);
  const auto file = folder.write("lidar.yaml", text);
  fuzz::is_done([&] { preset_names(file); });
  for (const char* preset : {"datasheet", "paper"}) {
    const auto dumped = dump(file, preset);
    if (!dumped || dumped->find("price_usd") == std::string::npos) continue;  // of several units
    fuzz::require(dump(folder.write("again.yaml", *dumped), preset) == dumped);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string input(reinterpret_cast<const char*>(data), size);
  read(input);
  read("name: n\nprice_usd: {low: 1, high: 2, source: s, date: d}\n" + input);
  return 0;
}
