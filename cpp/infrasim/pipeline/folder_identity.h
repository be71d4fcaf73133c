#pragma once

#include <filesystem>
#include <string>

// Determines whether a folder contains the frames of a run. The files of the folder may come from
// another version of the program, whose files have other key names and fewer or more values.
// Therefore the functions compare identities of the files and not their texts.

namespace infrasim {

/// Returns a text that identifies the frames described by a dataset.yaml: the scene, the preset and
/// the frames' version number (kFramesVersion), under canonical keys. A file from program version
/// 0.3, which has no such number, gets the number 3.
/// @throws ConfigError if the text is not a dataset.yaml
std::string data_set_identity(const std::string& text, const std::string& file);

/// Checks that the frames of a folder have the version number kFramesVersion.
/// @param description the folder's dataset.yaml, which need not exist
/// @throws IoError
void check_frames_version(const std::filesystem::path& description);

/// Returns the text of a lidar.yaml under canonical keys.
/// @throws ConfigError if the text is not a lidar.yaml
std::string lidar_identity(const std::string& text, const std::string& file);

}  // namespace infrasim
