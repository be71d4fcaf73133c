#include "infrasim/cli/catalogue.h"

#include <algorithm>
#include <array>

#include "infrasim/core/errors.h"

namespace infrasim::cli {

namespace {

namespace fs = std::filesystem;

/// Returns the folder of the catalogue; empty if there is none. It is found relative to the
/// program, which is in a Python package, an installation or a source tree.
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

}  // namespace

fs::path config_file(const std::string& word, const std::vector<std::string>& kinds) {
  if (word.find_first_of("/.") != std::string::npos) return word;
  const fs::path folder = catalogue();
  std::string known;
  for (const std::string& kind : kinds)
    for (const std::string& name : names(folder / kind)) {
      if (name == word) return folder / kind / (name + ".yaml");
      known += ", " + name;
    }
  throw ConfigError("(name): expected a path with a '/' or '.'" + known + ", got '" + word + "'");
}

}  // namespace infrasim::cli
