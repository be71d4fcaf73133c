#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "infrasim/core/geometry.h"

namespace infrasim {

/// One field of a point: `count` elements of type F, I or U with 1, 2, 4 or 8 bytes each.
struct CloudField {
  std::string name;
  char type = 'F';
  int size = 4;
  int count = 1;
};

/// Calls use(T{}), where T is the type of a field's elements.
template <class Use>
auto with_type(const CloudField& field, const Use& use) {
  if (field.type == 'F') return field.size == 4 ? use(float{}) : use(double{});
  const bool is_signed = field.type == 'I';
  switch (field.size) {
    case 1:
      return is_signed ? use(std::int8_t{}) : use(std::uint8_t{});
    case 2:
      return is_signed ? use(std::int16_t{}) : use(std::uint16_t{});
    case 4:
      return is_signed ? use(std::int32_t{}) : use(std::uint32_t{});
    default:
      return is_signed ? use(std::int64_t{}) : use(std::uint64_t{});
  }
}

/// The pose of the sensor in the frame of the scanned site: points are rotated by a unit quaternion
/// and then shifted.
struct Viewpoint {
  Vec3 shift;
  double w = 1;
  Vec3 axis;  ///< x y z of the quaternion

  bool is_identity() const;
  /// Returns whether the shift is 10 km or more along an axis, which is typical of map coordinates.
  /// apply() ignores such a shift.
  bool is_far() const;
  Vec3 apply(Vec3 stored) const;
};

enum class PcdEncoding { kAscii, kBinary, kBinaryCompressed };

/// The content of a point cloud file: one record of fields per point. Unknown fields are preserved.
struct CloudFile {
  std::vector<CloudField> fields;
  /// x y z of the sensor, then the quaternion w x y z of its rotation
  std::string viewpoint = "0 0 0 1 0 0 0";
  PcdEncoding encoding = PcdEncoding::kBinary;
  std::size_t points = 0;
  std::string records;  ///< points * record_size() bytes, little-endian

  std::size_t record_size() const;
  /// Returns the field with that name. If there is none, returns the only field whose name differs
  /// just in upper and lower case, otherwise null.
  const CloudField* field(std::string_view name) const;
  /// Returns the first element of a field at each point, as float; empty if the field does not
  /// exist.
  std::vector<float> column(std::string_view name) const;
  /// Returns the values of the first field that has a usual name for the intensity; empty if there
  /// is no such field.
  std::vector<float> intensity() const;
  /// Returns the smallest of 1, 255 and 65535 that no intensity exceeds, as in `pyinfra import`.
  /// Returns 1 if there is no intensity, or if an intensity is above 65535.
  float intensity_max() const;
  /// Returns x y z of all points as stored, row-major.
  std::vector<float> xyz() const;
  /// Returns x y z of all points transformed by the viewpoint, row-major. The point 0 0 0 means no
  /// return and is not moved.
  std::vector<float> moved_xyz() const;
  Viewpoint pose() const;
  CloudFile select(std::span<const int> keep) const;
};

/// Reads .pcd (version 0.7: ascii, binary, binary_compressed) or KITTI's .bin.
/// @throws ConfigError if the content is malformed: `file:line:1: key: expected ..., got ...`
/// @throws IoError if it can't be read
CloudFile read_cloud(const std::filesystem::path& file);

/// Writes a cloud in the format of the file's suffix. A .bin gets x y z intensity, with 0 for a
/// missing intensity, and intensities divided by `intensity_max`. A .bin has no viewpoint, so its
/// points are transformed by the cloud's viewpoint.
/// @throws ConfigError for a suffix other than .pcd and .bin, IoError if the file can't be written
void write_cloud(const std::filesystem::path& file, const CloudFile& cloud,
                 float intensity_max = 1);

// These functions are like read_cloud and write_cloud, for bytes in memory. Messages use `name` as
// the file name.
CloudFile parse_bin(std::string_view bytes, const std::string& name);
CloudFile parse_pcd(std::string_view bytes, const std::string& name);
std::string pcd_bytes(const CloudFile& cloud);
std::string bin_bytes(const CloudFile& cloud, float intensity_max = 1);

/// Returns the records of a .bin file: x y z intensity of each point.
/// @param xyz row-major points
std::string bin_records(std::span<const float> xyz, std::span<const float> intensity);

}  // namespace infrasim
