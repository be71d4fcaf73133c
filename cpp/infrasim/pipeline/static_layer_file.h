#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "infrasim/pipeline/static_layer.h"

namespace infrasim {

/// The static layer of all units of one LiDAR, read in place of casting what stands still.
struct StaticLayerFile {
  std::string name;    ///< the file's path, for messages
  std::string digest;  ///< of the file's bytes
  std::vector<StaticHits> units;
};

/// Hits as bytes: the text line "infrasim-static-layer 1", int32 units; for each unit uint64 digest
/// of the directions, int32 groups of a period, int32 rays of a group, float32 max_range_m; then
/// for each unit float32 range_m, float32 cos_incidence and uint16 class_id of all rays of a
/// period. Little-endian, packed.
std::string static_layer_to_bytes(std::span<const StaticHits> units);

/// @param name the file's path, for messages
/// @throws ConfigError if the bytes are not a whole and sane layer
StaticLayerFile static_layer_from_bytes(std::string_view bytes, const std::string& name);

/// @throws ConfigError, IoError
StaticLayerFile read_static_layer(const std::filesystem::path& file);

/// @param own   units of the LiDAR that the file is to be of; their hits do not matter
/// @param lidar the LiDAR, for messages
/// @throws ConfigError if the file is of another LiDAR, pattern, range, or way of looking
void check_is_of(const StaticLayerFile& file, std::span<const StaticHits> own,
                 const std::string& lidar);

}  // namespace infrasim
