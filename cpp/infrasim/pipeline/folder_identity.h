#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"

// Determines whether a folder contains the frames of a run. The files of the folder may come from
// another version, which has other key names and fewer or more values. Therefore the identities of
// the files are compared, and not their texts.

namespace infrasim {

/// The identity of the frames in a dataset.yaml, by canonical keys: the scene, the preset and the
/// frames' version number (kFramesVersion). A file without that number gets the number of its
/// version. If frames of its scene have changed without a new number, the identity contains
/// the reason instead of a number.
/// @throws ConfigError if the text is not a dataset.yaml
std::string data_set_identity(const std::string& text, const std::string& file);

/// Refuses to add frames to a folder of an earlier version with the same number, if the frames of a
/// LiDAR have changed since.
/// @param description the folder's dataset.yaml
/// @param end         one past the last frame of the run
/// @throws IoError
void check_is_not_older(const std::filesystem::path& description,
                        const std::vector<LidarConfig>& lidars, int end);

/// A lidar.yaml with canonical keys.
/// @throws ConfigError if the text is not a lidar.yaml
std::string lidar_identity(const std::string& text, const std::string& file);

}  // namespace infrasim
