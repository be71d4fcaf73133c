#include "infrasim/cli/catalogue.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <numeric>
#include <utility>

#include "infrasim/config/lidar_changes.h"
#include "infrasim/core/errors.h"

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

/// Names in one folder of the catalogue, sorted.
std::vector<std::string> names(const fs::path& folder) {
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.path().extension() == ".yaml") names.push_back(entry.path().stem().string());
  std::ranges::sort(names);
  return names;
}

/// Edit distance of two words: the number of letters to change, insert or remove.
std::size_t edits(const std::string& a, const std::string& b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0U);
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i + 1);
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t changed = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = row[j + 1];
      row[j + 1] = std::min({changed, row[j] + 1, row[j + 1] + 1});
    }
  }
  return row.back();
}

/// Returns a text such as `; did you mean 'highway'?`, or an empty text if no name is similar.
std::string suggestion(const std::string& word, const std::vector<std::string>& known) {
  const auto nearest = std::ranges::min_element(
      known, {}, [&](const std::string& name) { return edits(name, word); });
  if (nearest == known.end() || edits(*nearest, word) > word.size() / 3) return "";
  return "; did you mean '" + *nearest + "'?";
}

}  // namespace

fs::path config_file(const std::string& word, const std::vector<std::string>& kinds) {
  if (word.find_first_of("/.") != std::string::npos) return word;
  const fs::path folder = catalogue();
  std::vector<std::string> known;
  for (const std::string& kind : kinds)
    for (const std::string& name : names(folder / kind)) {
      if (name == word) return folder / kind / (name + ".yaml");
      known.push_back(name);
    }
  std::string listed;
  for (const std::string& name : known) listed += ", " + name;
  throw ConfigError("(name): expected a path with a '/' or '.'" + listed + ", got '" + word + "'" +
                    suggestion(word, known));
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
