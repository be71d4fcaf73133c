#include "infrasim/pipeline/folder_identity.h"

#include <algorithm>
#include <sstream>

#include "infrasim/config/lidar_config.h"
#include "infrasim/config/scene_config.h"
#include "infrasim/config/tree.h"
#include "infrasim/core/version.h"

namespace infrasim {

namespace {

/// Returns the version number of the frames of a folder, from two keys of its dataset.yaml. Program
/// versions before 0.4 wrote no such number. Version 0.3 gets the number 3; earlier versions get a
/// text with the program version.
std::string frames_version_of(const config::Tree* number, const config::Tree* version) {
  if (number != nullptr) return number->scalar;
  if (version == nullptr) return "unknown";
  return version->scalar.starts_with("0.3.") ? "3" : "unknown, of version " + version->scalar;
}

/// Removes the lines with the paths of firing tables, because digests identify the tables.
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

/// Removes a key from a map and returns the key with its value as a line of text. Returns an empty
/// text if the key is missing.
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
            frames_version_of(number ? &*number : nullptr, version ? &*version : nullptr) + "\n";
  return canonical_scene(tree) + of_run;
}

void check_frames_version(const std::filesystem::path& description) {
  if (!std::filesystem::exists(description)) return;
  config::Tree tree;
  try {
    tree = config::read_tree(description);
  } catch (const ConfigError&) {
    return;  // a later comparison of the file reports the error
  }
  const config::Tree* number = tree.find("frames_version");
  const config::Tree* version = tree.find("version");
  if (number == nullptr && version == nullptr) return;  // the file does not come from a simulation
  const std::string found = frames_version_of(number, version);
  const std::string expected = std::to_string(kFramesVersion);
  if (found == expected) return;
  const int line = (number != nullptr ? number : version)->place.line;
  throw IoError(description.string() + ":" + std::to_string(line) + ": frames_version: expected " +
                expected + ", got " + found + ": simulate again in another folder");
}

std::string lidar_identity(const std::string& text, const std::string& file) {
  const std::size_t end = text.find("\npreset: ");  // end of the LiDAR's configuration
  const config::Tree tree = config::parse_tree(text.substr(0, end), file);
  if (end == std::string::npos ||
      (tree.find("pattern") == nullptr && tree.find("bundle") == nullptr))
    return text;  // the lidar.yaml of fused frames has neither pattern nor bundle
  return without_files(canonical_lidar(tree)) + text.substr(end + 1);
}

}  // namespace infrasim
