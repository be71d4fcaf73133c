#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "fuzz_folder.h"
#include "infrasim/config/lidar_config.h"

// Input: the text of a LiDAR file, whole or below a name and a price. It is read or refused with a
// ConfigError (an IoError for a file that it names); what was read dumps to a text that reads back
// to the same dump.

namespace {

using namespace infrasim;

std::optional<std::string> dump(const std::filesystem::path& file, const std::string& preset) {
  std::optional<std::string> text;
  try {
    fuzz::is_done([&] { text = dump_lidar(read_lidar(file, preset)); });
  } catch (const IoError&) {
  }
  return text;
}

void read(const std::string& text) {
  static const fuzz::Folder folder;
  static const bool linked = [] {
    std::filesystem::create_directory_symlink(
        std::filesystem::path(INFRASIM_SOURCE_DIR) / "configs" / "lidars" / "channels",
        folder.path() / "channels");
    return true;
  }();
  static_cast<void>(linked);
  const auto file = folder.write("lidar.yaml", text);
  fuzz::is_done([&] { preset_names(file); });
  for (const char* preset : {"datasheet", "paper"}) {
    const auto dumped = dump(file, preset);
    if (!dumped || dumped->starts_with("bundle") || dumped->find("price_usd") == std::string::npos)
      continue;
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
