#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "infrasim/core/frame.h"

// The KITTI object layout, with `objects` and `fields` beside it. The camera frame exists only
// here: x right, y down, z forward, at the sensor.

namespace infrasim {

/// One line per object: type truncated occluded alpha bbox h w l x y z rotation_y. Location is the
/// bottom centre in the camera frame; occluded is 0, 1, 2 from visibility 0.8 and 0.4 down, 3 if
/// unknown. The 2-D box is a stand-in, as there is no camera.
/// @param all also objects without a point
std::string label_text(const std::vector<ObjectRecord>& objects, bool all, LabelTime time);

/// The seven lines of a calibration file, for a camera at the sensor that looks along x.
std::string calib_text();

/// Columns id,class,x,y,z,dx,dy,dz,heading,speed,points,points_in_box,distance,visibility,
/// scan_x,scan_y,scan_z,scan_heading,scan_time_s,points_in_scan_box.
std::string objects_csv(const std::vector<ObjectRecord>& objects, bool pitched = false);

/// Per point float32 x y z intensity, little-endian.
std::vector<std::byte> velodyne_bytes(const PointCloud& cloud);

/// Per point float32 time_s, uint16 ring, uint16 class, int32 object_id, packed, little-endian.
std::vector<std::byte> fields_bytes(const PointCloud& cloud);

/// NNNNNN
std::string frame_name(int frame);

std::filesystem::path velodyne_file(const std::filesystem::path& lidar_folder, int frame);

/// What one frame adds to the summary of a run; people are no vehicles.
struct FrameCounts {
  std::size_t hits = 0;
  std::size_t vehicles = 0;
  std::size_t vehicle_points = 0;
};
FrameCounts count(const Frame& frame);

/// Counts of a frame on disk.
/// @throws IoError if a file is missing or malformed
FrameCounts read_counts(const std::filesystem::path& lidar_folder, int frame);

/// Numbers of the frames in a LiDAR's folder, ascending.
/// @throws IoError if there is no folder of them
std::vector<int> frames_on_disk(const std::filesystem::path& lidar_folder);

/// Points of a frame on disk.
struct RecordedPoints {
  std::vector<float> xyz;  ///< row-major, metres, levelled frame
  std::vector<float> intensity;
  std::vector<std::uint16_t> ring;
};
/// @throws IoError if a file can't be read, ConfigError if one is malformed
RecordedPoints read_points(const std::filesystem::path& lidar_folder, int frame);

/// What of a frame is written.
struct FrameContent {
  bool all_labels = false;  ///< also of objects without a point
  LabelTime label_time = LabelTime::kFrame;
  bool point_fields = false;
};

/// Writes which mount each point of a fused frame is of: uint16, little-endian.
/// @throws IoError
void write_point_mounts(const std::filesystem::path& lidar_folder, int frame,
                        std::span<const std::uint16_t> mounts);

/// Writes one frame below `training/`, each file beside its place and renamed, the .bin last: a
/// frame exists if and only if its .bin does.
/// @throws IoError
void write_frame(const std::filesystem::path& lidar_folder, int frame, const Frame& data,
                 const FrameContent& content);

/// Creates the folders of a LiDAR.
/// @throws IoError
void create_frame_folders(const std::filesystem::path& lidar_folder, bool point_fields);

}  // namespace infrasim
