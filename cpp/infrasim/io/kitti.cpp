#include "infrasim/io/kitti.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <initializer_list>
#include <span>

#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/core/math.h"
#include "infrasim/core/numbers.h"
#include "infrasim/io/atomic_file.h"
#include "infrasim/io/cloud_file.h"
#include "infrasim/io/csv.h"
#include "infrasim/io/data_set.h"

namespace infrasim {

static_assert(std::endian::native == std::endian::little, "the files are little-endian");

namespace {

constexpr char kObjectColumns[] =
    "id,class,x,y,z,dx,dy,dz,heading,speed,points,points_in_box,distance,visibility,"
    "scan_x,scan_y,scan_z,scan_heading,scan_time_s,points_in_scan_box";

constexpr std::size_t kFieldsRecord = 12;

/// Appends numbers, each preceded by the separator.
void append_all(std::string& text, char separator, int digits,
                std::initializer_list<double> values) {
  for (const double value : values) {
    text += separator;
    append_fixed(text, value, digits);
  }
}

void append_counts(std::string& text, std::initializer_list<int> values) {
  for (const int value : values) text += "," + std::to_string(value);
}

int occluded(double visibility) {
  if (visibility < 0) return 3;
  return visibility >= 0.8 ? 0 : visibility >= 0.4 ? 1 : 2;
}

}  // namespace

std::string label_text(const std::vector<ObjectRecord>& objects, bool all, LabelTime time) {
  std::string text;
  for (const ObjectRecord& o : objects) {
    if (!all && o.points == 0) continue;
    const Box3d& b = time == LabelTime::kScan ? o.scan_box : o.box;
    const double x = -b.y, y = -(b.z - b.dz / 2), z = b.x;  // position in the camera frame
    const double rotation_y = wrap_angle(-b.heading - kPi / 2);
    text += class_of(o.object_class).name;
    text += " 0.00 " + std::to_string(occluded(o.visibility));
    append_all(text, ' ', 6, {wrap_angle(rotation_y - math::atan2(x, z))});
    text += " 0.00 0.00 50.00 50.00";
    append_all(text, ' ', 4, {b.dz, b.dy, b.dx, x, y, z});
    append_all(text, ' ', 6, {rotation_y});
    text += '\n';
  }
  return text;
}

std::string calib_text() {
  std::string text;
  for (int camera = 0; camera < 4; ++camera)
    text += "P" + std::to_string(camera) + ": 700 0 600 0 0 700 180 0 0 0 1 0\n";
  text += "R0_rect: 1 0 0 0 1 0 0 0 1\n";
  text += "Tr_velo_to_cam: 0 -1 0 0 0 0 -1 0 1 0 0 0\n";
  text += "Tr_imu_to_velo: 1 0 0 0 0 1 0 0 0 0 1 0\n";
  return text;
}

std::string objects_csv(const std::vector<ObjectRecord>& objects, bool pitched) {
  std::string text = std::string(kObjectColumns) + (pitched ? ",pitch\n" : "\n");
  for (const ObjectRecord& o : objects) {
    const Box3d &b = o.box, &s = o.scan_box;
    text += std::to_string(o.id) + ",";
    text += class_of(o.object_class).name;
    append_all(text, ',', 4, {b.x, b.y, b.z, b.dx, b.dy, b.dz});
    append_all(text, ',', 6, {b.heading});
    append_all(text, ',', 4, {o.speed_m_s});
    append_counts(text, {o.points, o.points_in_box});
    append_all(text, ',', 4, {o.distance, o.visibility, s.x, s.y, s.z});
    append_all(text, ',', 6, {s.heading, o.scan_time_s});
    append_counts(text, {o.points_in_scan_box});
    if (pitched) append_all(text, ',', 6, {b.pitch});
    text += '\n';
  }
  return text;
}

std::string velodyne_bytes(const PointCloud& cloud) {
  return bin_records(cloud.xyz, cloud.intensity);
}

std::string fields_bytes(const PointCloud& cloud) {
  std::string bytes(kFieldsRecord * cloud.size(), '\0');
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    char* at = &bytes[kFieldsRecord * i];
    std::memcpy(at, &cloud.time[i], 4);
    std::memcpy(at + 4, &cloud.ring[i], 2);
    const std::array<std::uint8_t, 2> class_and_echo{static_cast<std::uint8_t>(cloud.class_id[i]),
                                                     cloud.echo[i]};
    std::memcpy(at + 6, class_and_echo.data(), 2);
    std::memcpy(at + 8, &cloud.object_id[i], 4);
  }
  return bytes;
}

std::string frame_name(int frame) {
  std::array<char, 16> name{};
  std::snprintf(name.data(), name.size(), "%06d", frame);
  return name.data();
}

std::filesystem::path velodyne_file(const std::filesystem::path& lidar_folder, int frame) {
  return lidar_folder / "training" / "velodyne" / (frame_name(frame) + ".bin");
}

FrameCounts count(const Frame& frame) {
  FrameCounts counts{frame.cloud.size(), 0, 0};
  for (const ObjectRecord& o : frame.objects) {
    if (!class_of(o.object_class).vehicle) continue;
    ++counts.vehicles;
    counts.vehicle_points += static_cast<std::size_t>(o.points);
  }
  return counts;
}

FrameCounts read_counts(const std::filesystem::path& lidar_folder, int frame) {
  FrameCounts counts;
  const auto cloud = velodyne_file(lidar_folder, frame);
  std::error_code error;
  counts.hits = std::filesystem::file_size(cloud, error) / 16;
  if (error) throw IoError(cloud.string() + ": can't be read: " + error.message());
  CsvReader csv(lidar_folder / "training" / "objects" / (frame_name(frame) + ".csv"),
                kObjectColumns, "pitch");
  while (csv.next_row()) {
    csv.cell();  // skips the id
    const ObjectClass* object_class = find_class(csv.cell());
    for (int column = 2; column < 10; ++column) csv.cell();
    const double points = csv.number("points", 0, 1e9);
    if (object_class != nullptr && !object_class->vehicle) continue;
    ++counts.vehicles;
    counts.vehicle_points += static_cast<std::size_t>(points);
  }
  return counts;
}

std::vector<int> frames_on_disk(const std::filesystem::path& lidar_folder) {
  const auto folder = lidar_folder / "training" / "velodyne";
  std::error_code error;
  std::vector<int> frames;
  for (const std::filesystem::path& entry : entries_of(folder, error)) {
    const std::string stem = entry.stem().string();
    const auto frame = parse_number<int>(stem);
    if (frame && *frame >= 0 && frame_name(*frame) == stem && entry.extension() == ".bin")
      frames.push_back(*frame);
  }
  if (error) throw IoError(folder.string() + ": can't be read: " + error.message());
  std::ranges::sort(frames);
  return frames;
}

RecordedPoints read_points(const std::filesystem::path& lidar_folder, int frame) {
  const CloudFile cloud = read_cloud(velodyne_file(lidar_folder, frame));
  const auto file = lidar_folder / "training" / "fields" / (frame_name(frame) + ".bin");
  const std::string bytes = read_file(file);
  if (bytes.size() != kFieldsRecord * cloud.points)
    throw ConfigError(file.string() + ": expected " + std::to_string(kFieldsRecord) +
                      " bytes for each of " + std::to_string(cloud.points) + " points, got " +
                      std::to_string(bytes.size()) + " bytes");
  RecordedPoints points{cloud.xyz(), cloud.column("intensity"), {}};
  points.ring.resize(cloud.points);
  for (std::size_t i = 0; i < cloud.points; ++i)
    std::memcpy(&points.ring[i], &bytes[kFieldsRecord * i + 4], 2);
  return points;
}

void write_point_mounts(const std::filesystem::path& lidar_folder, int frame,
                        std::span<const std::uint16_t> mounts) {
  write_file_atomically(lidar_folder / "training" / "mounts" / (frame_name(frame) + ".bin"),
                        {reinterpret_cast<const char*>(mounts.data()), mounts.size_bytes()});
}

void write_frame(const std::filesystem::path& lidar_folder, int frame, const Frame& data,
                 const FrameContent& content) {
  const auto training = lidar_folder / "training";
  const std::string name = frame_name(frame);
  write_file_atomically(training / "objects" / (name + ".csv"),
                        objects_csv(data.objects, data.pitched));
  write_file_atomically(training / "label_2" / (name + ".txt"),
                        label_text(data.objects, content.all_labels, content.label_time));
  static const std::string kCalib = calib_text();
  write_file_atomically(training / "calib" / (name + ".txt"), kCalib);
  if (content.point_fields)
    write_file_atomically(training / "fields" / (name + ".bin"), fields_bytes(data.cloud));
  write_file_atomically(velodyne_file(lidar_folder, frame), velodyne_bytes(data.cloud));
}

void create_frame_folders(const std::filesystem::path& lidar_folder, bool point_fields) {
  for (const char* name : {"objects", "label_2", "calib", "velodyne", "fields"}) {
    if (std::string(name) == "fields" && !point_fields) continue;
    create_folder(lidar_folder / "training" / name);
  }
  create_folder(lidar_folder);
}

}  // namespace infrasim
