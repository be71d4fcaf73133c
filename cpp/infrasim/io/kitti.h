#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "infrasim/core/frame.h"

// Files of the KITTI object layout, with the additional folders `objects` and `fields`. Only this
// file uses the camera frame: x right, y down, z forward, at the sensor.

namespace infrasim {

/// Returns the text of a label file, one line per object: type truncated occluded alpha bbox h w l
/// x y z rotation_y. The location is the bottom centre in the camera frame. `occluded` is 0 for a
/// visible share of at least 0.8, 1 for at least 0.4, 2 for less, and 3 if the share is unknown.
/// The 2-D box is a placeholder, because there is no camera.
/// @param all whether to include objects without a point
std::string label_text(const std::vector<ObjectRecord>& objects, bool all, LabelTime time);

/// Returns the seven lines of a calibration file. The camera is at the sensor and looks along x.
std::string calib_text();

/// Returns a table of objects with the columns
/// id,class,x,y,z,dx,dy,dz,heading,speed,points,points_in_box,distance,visibility,
/// scan_x,scan_y,scan_z,scan_heading,scan_time_s,points_in_scan_box. If `pitched` is true, the last
/// column is `pitch`.
std::string objects_csv(const std::vector<ObjectRecord>& objects, bool pitched = false);

/// Returns x y z intensity of each point as float32, little-endian.
std::string velodyne_bytes(const PointCloud& cloud);

/// Returns float32 time_s, uint16 ring, uint8 class, uint8 echo, int32 object_id of each point,
/// packed, little-endian.
std::string fields_bytes(const PointCloud& cloud);

/// Returns a frame number with six digits, such as 000123.
std::string frame_name(int frame);

std::filesystem::path velodyne_file(const std::filesystem::path& lidar_folder, int frame);

/// The contribution of one frame to the summary of a run. Pedestrians and cyclists are not counted
/// as vehicles.
struct FrameCounts {
  std::size_t hits = 0;
  std::size_t vehicles = 0;
  std::size_t vehicle_points = 0;
};
FrameCounts count(const Frame& frame);

/// Returns the counts of a frame on disk.
/// @throws IoError if a file is missing or malformed
FrameCounts read_counts(const std::filesystem::path& lidar_folder, int frame);

/// Returns the numbers of the frames in a LiDAR's folder, ascending.
/// @throws IoError if the folder does not exist
std::vector<int> frames_on_disk(const std::filesystem::path& lidar_folder);

/// Points of a frame on disk.
struct RecordedPoints {
  std::vector<float> xyz;  ///< x y z in metres, row-major, in the levelled frame
  std::vector<float> intensity;
  std::vector<std::uint16_t> ring;
};
/// Returns the points of a frame on disk.
/// @throws IoError if a file can't be read, ConfigError if one is malformed
RecordedPoints read_points(const std::filesystem::path& lidar_folder, int frame);

/// Which parts of a frame are written.
struct FrameContent {
  bool all_labels = false;  ///< whether labels include objects without a point
  LabelTime label_time = LabelTime::kFrame;
  bool point_fields = false;
};

/// Writes the mount index of each point of a fused frame: uint16, little-endian.
/// @throws IoError
void write_point_mounts(const std::filesystem::path& lidar_folder, int frame,
                        std::span<const std::uint16_t> mounts);

/// Writes one frame below `training/`. Each file is written under a temporary name and then
/// renamed. The file in `velodyne/` is written last, so a frame is complete if and only if this
/// file exists.
/// @throws IoError
void write_frame(const std::filesystem::path& lidar_folder, int frame, const Frame& data,
                 const FrameContent& content);

/// Creates the folders for the frames of a LiDAR.
/// @throws IoError
void create_frame_folders(const std::filesystem::path& lidar_folder, bool point_fields);

}  // namespace infrasim
