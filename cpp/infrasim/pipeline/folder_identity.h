#pragma once

#include <filesystem>
#include <string>

// Determines whether a folder contains the frames of a run. The files of the folder may come from
// another version, which has other key names and fewer or more values. Therefore the identities of
// the files are compared, and not their texts.

namespace infrasim {

/// The identity of the frames in a dataset.yaml, by canonical keys: the scene, the preset and the
/// frames' version number (kFramesVersion). A file of version 0.3, which has no number, gets 3.
/// @throws ConfigError if the text is not a dataset.yaml
std::string data_set_identity(const std::string& text, const std::string& file);

/// Refuses a folder whose frames have another version number than kFramesVersion.
/// @param description the folder's dataset.yaml, which need not exist
/// @throws IoError
void check_frames_version(const std::filesystem::path& description);

/// A lidar.yaml with canonical keys.
/// @throws ConfigError if the text is not a lidar.yaml
std::string lidar_identity(const std::string& text, const std::string& file);

}  // namespace infrasim
