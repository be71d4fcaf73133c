#pragma once

#include <string>

// Whether a folder holds the frames of a run. Its files may come from another version, with other
// key names and additional values. So identities are compared instead of texts.

namespace infrasim {

/// The identity of the frames in a dataset.yaml, by canonical keys: the scene, the preset and the
/// frames' version number (kFramesVersion). A file without that number gets the number of its
/// version.
/// @throws ConfigError if the text is not a dataset.yaml
std::string data_set_identity(const std::string& text, const std::string& file);

/// A lidar.yaml with canonical keys.
/// @throws ConfigError if the text is not a lidar.yaml
std::string lidar_identity(const std::string& text, const std::string& file);

}  // namespace infrasim
