#pragma once

#include <stdlib.h>  // NOLINT(modernize-deprecated-headers): mkdtemp is POSIX

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string_view>

#include "infrasim/core/errors.h"

namespace infrasim::fuzz {

inline void require(bool holds) {
  if (!holds) std::abort();
}

/// A folder of its own for a target that reads files; left behind by a crash.
class Folder {
 public:
  Folder() {
    const std::filesystem::path memory = "/dev/shm";  // where it is there: five times as fast
    const auto place =
        std::filesystem::exists(memory) ? memory : std::filesystem::temp_directory_path();
    std::string name = (place / "infrasim_fuzz_XXXXXX").string();
    require(::mkdtemp(name.data()) != nullptr);
    path_ = name;
  }
  ~Folder() { std::filesystem::remove_all(path_); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;

  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path write(const char* name, std::string_view bytes) const {
    std::ofstream(path_ / name, std::ios::binary) << bytes;
    return path_ / name;
  }

 private:
  std::filesystem::path path_;
};

/// Whether the action is done or refused with a ConfigError.
template <class Action>
bool is_done(const Action& action) {
  try {
    action();
    return true;
  } catch (const ConfigError&) {
    return false;
  }
}

}  // namespace infrasim::fuzz
