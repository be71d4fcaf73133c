#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "infrasim/config/scene_config.h"
#include "infrasim/core/triangle_mesh.h"
#include "infrasim/pipeline/static_layer.h"

namespace infrasim {

/// Where a static layer was made, and of what.
struct LayerOrigin {
  std::array<double, 6> mount{};  ///< x_m, y_m, z_m, yaw_deg, pitch_deg, roll_deg
  std::uint64_t scene = 0;        ///< digest of all that stands still; 0: of a recording
};

/// @param scene      at one mount
/// @param background all that stands still in it, levelled frame
LayerOrigin layer_origin(const SceneConfig& scene, const TriangleMesh& background);

/// The static layer of all units of one LiDAR, read in place of casting what stands still.
struct StaticLayerFile {
  std::string name;    ///< the file's path, for messages
  std::string digest;  ///< of the file's bytes
  LayerOrigin origin;
  std::vector<StaticHits> units;
};

/// Hits as bytes: the text line "infrasim-static-layer 2"; six float64 of the mount and uint64
/// digest of the scene; int32 units; for each unit uint64 digest of the directions, int32 groups of
/// a period, int32 rays of a group, float32 max_range_m; then for each unit float32 range_m,
/// float32 cos_incidence and uint16 class_id of all rays of a period. Little-endian, packed.
std::string static_layer_to_bytes(const LayerOrigin& origin, std::span<const StaticHits> units);

/// @param name the file's path, for messages
/// @throws ConfigError if the bytes are not a whole and sane layer
StaticLayerFile static_layer_from_bytes(std::string_view bytes, const std::string& name);

/// @throws ConfigError, IoError
StaticLayerFile read_static_layer(const std::filesystem::path& file);

/// @throws ConfigError if the file was made at another mount
void check_is_at(const StaticLayerFile& file, const MountConfig& mount);

/// @param here  of the scene that is to take the file
/// @throws ConfigError if other things stand still in it, unless the file is of a recording
void check_is_from(const StaticLayerFile& file, const LayerOrigin& here);

/// @param units units of the LiDAR that the file is to be of; their hits do not matter
/// @param lidar the LiDAR, for messages
/// @throws ConfigError if the file is of another LiDAR, pattern, range, or way of looking
void check_is_of(const StaticLayerFile& file, std::span<const StaticHits> units,
                 const std::string& lidar);

}  // namespace infrasim
