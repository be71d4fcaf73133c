#pragma once

#include <string>

// Whether a folder holds the frames of a run. Its files say more than that, and say it in the words
// of the version that wrote them.

namespace infrasim {

/// What a dataset.yaml says of its frames, by canonical names: the scene, the preset, the number of
/// the frames (kFramesVersion; of a version that did not write it, that of the version).
/// @throws ConfigError if it is none
std::string data_set_identity(const std::string& text, const std::string& file);

/// A lidar.yaml with its keys by canonical names.
/// @throws ConfigError if it is none
std::string lidar_identity(const std::string& text, const std::string& file);

}  // namespace infrasim
