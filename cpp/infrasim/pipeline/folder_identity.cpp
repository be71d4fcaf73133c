#include "infrasim/pipeline/folder_identity.h"

#include <algorithm>
#include <sstream>

#include "infrasim/config/lidar_config.h"
#include "infrasim/config/scene_config.h"
#include "infrasim/config/tree.h"
#include "infrasim/core/version.h"

namespace infrasim {

namespace {

/// The frames' version number of a folder without one: version 0.3 did not write it.
std::string frames_version_of(const std::string& version) {
  return version.starts_with("0.3.") ? "3" : "unknown, of version " + version;
}

/// Removes the lines with paths of firing tables, because their digests identify them.
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

/// Takes a text out of a map and returns it as a line; empty if it is missing.
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
            (number ? number->scalar : frames_version_of(version ? version->scalar : "")) + "\n";
  return canonical_scene(tree) + of_run;
}

std::string lidar_identity(const std::string& text, const std::string& file) {
  const std::size_t end = text.find("\npreset: ");  // the preset of the LiDAR's own keys
  const config::Tree tree = config::parse_tree(text.substr(0, end), file);
  if (end == std::string::npos ||
      (tree.find("pattern") == nullptr && tree.find("bundle") == nullptr))
    return text;  // with several mounts, the files of the mounts have the keys
  return without_files(canonical_lidar(tree)) + text.substr(end + 1);
}

}  // namespace infrasim
