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

/// The mount and the scene from which a static layer was made.
struct LayerOrigin {
  std::array<double, 6> mount{};  ///< x_m, y_m, z_m, yaw_deg, pitch_deg, roll_deg
  std::uint64_t scene = 0;        ///< digest of all static surfaces; 0 for a recording
};

/// Returns the origin of the static layers of a scene.
/// @param scene      scene at one mount
/// @param background all static surfaces of the scene, levelled frame
LayerOrigin layer_origin(const SceneConfig& scene, const TriangleMesh& background);

/// The static layers of all units of one LiDAR that were read from a file.
struct StaticLayerFile {
  std::string name;    ///< path of the file, for messages
  std::string digest;  ///< digest of the file's bytes
  LayerOrigin origin;
  std::vector<StaticHits> units;
};

/// Returns the content of a static layer file, as packed little-endian values:
/// - the text line "infrasim-static-layer 2";
/// - the mount (six float64) and the digest of the scene (uint64);
/// - the number of units (int32);
/// - for each unit: digest of the directions (uint64), groups per period (int32), rays per group
///   (int32) and max_range_m (float32);
/// - for each unit: range_m (float32), cos_incidence (float32) and class_id (uint16) of all rays of
///   a period.
std::string static_layer_to_bytes(const LayerOrigin& origin, std::span<const StaticHits> units);

/// @param name path of the file, for messages
/// @throws ConfigError if the bytes are not a complete and plausible static layer
StaticLayerFile static_layer_from_bytes(std::string_view bytes, const std::string& name);

/// @throws ConfigError, IoError
StaticLayerFile read_static_layer(const std::filesystem::path& file);

/// @throws ConfigError if the file was made at another pose than that of the mount
void check_is_at(const StaticLayerFile& file, const MountConfig& mount);

/// @param here  origin of the scene that uses the file
/// @throws ConfigError if the scene has other static surfaces, unless the file comes from a
///   recording
void check_is_from(const StaticLayerFile& file, const LayerOrigin& here);

/// @param units expected units of the LiDAR; their hits are not used
/// @param lidar name of the LiDAR, for messages
/// @throws ConfigError if the file was made for another LiDAR, pattern, range or viewing direction
void check_is_of(const StaticLayerFile& file, std::span<const StaticHits> units,
                 const std::string& lidar);

}  // namespace infrasim
