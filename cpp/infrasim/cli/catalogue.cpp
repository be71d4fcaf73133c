#include "infrasim/cli/catalogue.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <utility>

#include "infrasim/config/lidar_changes.h"
#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/core/hints.h"

namespace infrasim::cli {

namespace {

namespace fs = std::filesystem;

/// Returns the folder of the catalogue of configuration files; empty if there is none. The folder
/// is found relative to the program, which is in a Python package, an installation or a source
/// tree.
fs::path catalogue() {
  std::error_code error;
  const fs::path folder = fs::read_symlink("/proc/self/exe", error).parent_path();
  for (const char* place : {"../configs", "../share/infrasim/configs", "../../../configs"})
    if (fs::is_directory(folder / place / "lidars", error))
      return (folder / place).lexically_normal();
  return {};
}

/// Returns the sorted names in one folder of the catalogue.
std::vector<std::string> names(const fs::path& folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (const fs::path& entry : entries_of(folder, error))
    if (entry.extension() == ".yaml") names.push_back(entry.stem().string());
  std::ranges::sort(names);
  return names;
}

/// Returns the path of an existing file that was probably meant by a word without an ending.
/// Returns an empty text if there is none.
std::string file_like(const std::string& word) {
  std::error_code error;
  for (const char* rest : {".yaml", "/scene.yaml"})
    if (fs::is_regular_file(word + rest, error)) return word + rest;
  return "";
}

}  // namespace

fs::path config_file(const std::string& word, const std::vector<std::string>& kinds) {
  if (word.find_first_of("/.") != std::string::npos) return word;
  const fs::path folder = catalogue();
  std::vector<std::string> known;
  std::string expected = "a path with a '/' or '.'";
  for (const std::string& kind : kinds) {
    const std::vector<std::string> of_kind = names(folder / kind);
    for (const std::string& name : of_kind)
      if (name == word) return folder / kind / (name + ".yaml");
    known.insert(known.end(), of_kind.begin(), of_kind.end());
    if (!of_kind.empty())
      expected += (kind == "lidars" ? ", a LiDAR (" : ", a scene (") + listed(of_kind) + ")";
  }
  std::error_code error;
  const std::string given = (fs::is_directory(word, error) ? "the folder '" : "'") + word + "'";
  const std::string file = file_like(word);
  throw ConfigError("(name): expected " + expected + ", got " + given +
                    (file.empty() ? suggestion(word, known) : "; did you mean '" + file + "'?"));
}

LidarConfig with_changes(LidarConfig lidar, const LidarChanges& changes) {
  if (changes.rate_hz) lidar = with_rate(std::move(lidar), *changes.rate_hz);
  if (changes.law_exponent && !set_law_exponent(lidar, *changes.law_exponent))
    std::fprintf(stderr,
                 "infrasim: warning: --law-exponent: no effect on %s, preset %s, because its "
                 "published ranges determine the exponent or it has no returns.detection\n",
                 lidar.name.c_str(), lidar.preset.c_str());
  if (changes.echo) set_echo_mode(lidar, echo_mode(*changes.echo));
  return lidar;
}

LidarConfig lidar_of(const std::string& word, const std::string& preset,
                     const LidarChanges& changes) {
  return with_changes(read_lidar(config_file(word, {"lidars"}), preset), changes);
}

}  // namespace infrasim::cli
