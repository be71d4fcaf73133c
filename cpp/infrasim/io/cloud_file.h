#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "infrasim/core/geometry.h"

namespace infrasim {

/// One field of a point: F, I or U of 1, 2, 4 or 8 bytes, `count` of them.
struct CloudField {
  std::string name;
  char type = 'F';
  int size = 4;
  int count = 1;
};

/// The pose of the sensor in the frame of the place: a unit quaternion, then a shift.
struct Viewpoint {
  Vec3 shift;
  double w = 1;
  Vec3 axis;  ///< x y z of the quaternion

  bool is_identity() const;
  /// Whether the shift would move points farther than clouds reach, as one on Earth does; it is
  /// left out then.
  bool is_far() const;
  Vec3 apply(Vec3 stored) const;
};

enum class PcdEncoding { kAscii, kBinary, kBinaryCompressed };

/// A point cloud as a file holds it: records of fields, point by point. Fields that nobody here
/// knows survive.
struct CloudFile {
  std::vector<CloudField> fields;
  std::string viewpoint = "0 0 0 1 0 0 0";  ///< x y z of the sensor, then w x y z of its turn
  PcdEncoding encoding = PcdEncoding::kBinary;
  std::size_t points = 0;
  std::string records;  ///< points * record_size() bytes, little-endian

  std::size_t record_size() const;
  /// The field of that name, else the only one that differs from it in capitals alone; null if
  /// there is none.
  const CloudField* field(std::string_view name) const;
  /// Values of a field's first element as float; empty if there is no such field.
  std::vector<float> column(std::string_view name) const;
  /// Values of the first of the usual names of an intensity; empty if there is none.
  std::vector<float> intensity() const;
  /// Row-major x y z, as stored.
  std::vector<float> xyz() const;
  /// Row-major x y z where the viewpoint moves them; 0 0 0 stands for no return and stays.
  std::vector<float> moved_xyz() const;
  Viewpoint pose() const;
  CloudFile select(std::span<const int> keep) const;
};

/// Reads .pcd (version 0.7: ascii, binary, binary_compressed) or KITTI's .bin.
/// @throws ConfigError if the content is malformed: `file:line:1: key: found, allowed`
/// @throws IoError if it can't be read
CloudFile read_cloud(const std::filesystem::path& file);

/// The suffix decides the format. A .bin gets x y z intensity, 0 where the cloud has none; as it
/// has no viewpoint, its points are where the cloud's moves them.
/// @throws ConfigError for another suffix, IoError
void write_cloud(const std::filesystem::path& file, const CloudFile& cloud);

// The same on bytes; `name` stands for the file in messages.
CloudFile parse_bin(std::string_view bytes, const std::string& name);
CloudFile parse_pcd(std::string_view bytes, const std::string& name);
std::string pcd_bytes(const CloudFile& cloud);
std::string bin_bytes(const CloudFile& cloud);

}  // namespace infrasim
