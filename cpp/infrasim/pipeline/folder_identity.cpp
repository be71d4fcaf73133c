#include "infrasim/pipeline/folder_identity.h"

#include <algorithm>
#include <sstream>

#include "infrasim/config/lidar_config.h"
#include "infrasim/config/scene_config.h"
#include "infrasim/config/tree.h"
#include "infrasim/core/version.h"

namespace infrasim {

namespace {

bool is_0_3(const std::string& version) { return version.starts_with("0.3."); }

/// The property of a scene for which frames have changed since version 0.3; empty if there is none.
std::string changed_since_0_3(const config::Tree& scene) {
  const auto items = [&](const char* key) {
    const config::Tree* list = scene.find(key);
    return list == nullptr ? 0 : list->items.size();
  };
  const auto value = [&](const char* key, const char* inner) {
    const config::Tree* map = scene.find(key);
    const config::Tree* scalar = map == nullptr ? nullptr : map->find(inner);
    return scalar == nullptr ? "" : scalar->scalar;
  };
  const config::Tree* recorded = scene.find("trajectories");
  if (items("junctions") > 1 && items("traffic") > 0) return "several junctions";
  if (value("weather", "rain_mm_per_h") != "0" || value("weather", "visibility_m") != ".inf")
    return "rain or fog";
  if (value("vehicle_parts", "gap") == "true") {
    if (items("parked") > 0) return "parked vehicles";
    if (recorded != nullptr && !recorded->scalar.empty()) return "recorded vehicles";
  }
  return "";
}

/// The property of a LiDAR for which frames have changed since version 0.3; empty if there is none.
/// @param end one past the last frame
std::string changed_since_0_3(const LidarConfig& lidar, int end) {
  constexpr double kAviaBeam_deg = 0.28;
  constexpr int kEqualFrames = 1000;
  for (const LidarUnit& unit : lidar.units) {
    const auto& beam = unit.returns.beam;
    if (beam && std::max(beam->vertical_deg, beam->horizontal_deg) > kAviaBeam_deg)
      return "a beam wider than 0.28 degrees";
    const auto& spinning = unit.pattern.spinning;
    if (end > kEqualFrames && spinning && spinning->azimuth_step_deg && columns_per_turn(*spinning))
      return "azimuth_step_deg and frames from 1000 on";
  }
  return "";
}

/// The version number of the frames in a folder whose files, from version 0.3, have no such number.
std::string frames_version_of(const std::string& version, const config::Tree& scene) {
  if (!is_0_3(version)) return "unknown, of version " + version;
  const std::string changed = changed_since_0_3(scene);
  return changed.empty() ? "3"
                         : "3 of version 0.3, but frames have changed since for " + changed +
                               ": simulate again";
}

/// Removes the lines with paths of firing tables. The digests of the tables identify them.
std::string without_files(const std::string& text) {
  std::istringstream lines(text);
  std::string kept;
  for (std::string line; std::getline(lines, line);) {
    const std::size_t start = std::min(line.find_first_not_of(' '), line.size());
    const std::string_view key = std::string_view(line).substr(start);
    if (!key.starts_with("file: ") || key == "file: \"\"") kept += line + "\n";
  }
  return kept;
}

/// Removes a key from a map and returns it as a line of text; empty if the key is missing.
std::string taken(config::Tree& map, const std::string& key) {
  const auto value = config::take(map, key);
  return value ? key + ": \"" + value->scalar + "\"\n" : "";
}

}  // namespace

std::string data_set_identity(const std::string& text, const std::string& file) {
  config::Tree tree = config::parse_tree(text, file);
  std::string of_run = taken(tree, "surfaces") + taken(tree, "preset");
  const auto version = config::take(tree, "version");
  const auto number = config::take(tree, "frames_version");
  of_run += "frames_version: " +
            (number ? number->scalar : frames_version_of(version ? version->scalar : "", tree)) +
            "\n";
  return canonical_scene(tree) + of_run;
}

void check_is_not_older(const std::filesystem::path& description,
                        const std::vector<LidarConfig>& lidars, int end) {
  config::Tree tree;
  try {
    tree = config::read_tree(description);
  } catch (const ConfigError&) {
    return;  // the text of this run, which is compared as it is
  }
  const config::Tree* version = tree.find("version");
  if (version == nullptr || !is_0_3(version->scalar) || tree.find("frames_version") != nullptr)
    return;
  for (const LidarConfig& lidar : lidars)
    if (const std::string changed = changed_since_0_3(lidar, end); !changed.empty())
      throw IoError(description.string() +
                    ": version: expected the current version, because frames have changed since "
                    "0.3 for a LiDAR with " +
                    changed + ", got " + version->scalar + "; simulate " + lidar.name +
                    " again in another folder");
}

std::string lidar_identity(const std::string& text, const std::string& file) {
  const std::size_t end = text.find("\npreset: ");  // end of the LiDAR's configuration
  const config::Tree tree = config::parse_tree(text.substr(0, end), file);
  if (end == std::string::npos ||
      (tree.find("pattern") == nullptr && tree.find("bundle") == nullptr))
    return text;  // lidar.yaml of fused frames has no such keys
  return without_files(canonical_lidar(tree)) + text.substr(end + 1);
}

}  // namespace infrasim
