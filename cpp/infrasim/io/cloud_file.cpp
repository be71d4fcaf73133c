#include "infrasim/io/cloud_file.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <sstream>

#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/io/atomic_file.h"

namespace infrasim {

namespace {

float element(const CloudField& field, const char* at) {
  return with_type(field, [&]<class T>(T value) {
    std::memcpy(&value, at, sizeof(T));
    return static_cast<float>(value);
  });
}

bool same_but_for_capitals(std::string_view a, std::string_view b) {
  const auto small = [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c + 32) : c; };
  return std::ranges::equal(a, b, {}, small, small);
}

/// Usual names of the intensity field, as in pyinfra/exchange/pcd.py.
constexpr const char* kIntensities[] = {
    "intensity",        "reflectivity",        "i",
    "intensities",      "reflectance",         "remission",
    "scalar_intensity", "scalar_reflectivity", "scalar_reflectance"};

bool is_pcd(const std::filesystem::path& file) {
  if (file.extension() == ".pcd" || file.extension() == ".bin") return file.extension() == ".pcd";
  throw ConfigError("expected a name that ends in .bin or .pcd, got '" + file.string() + "'");
}

}  // namespace

std::size_t CloudFile::record_size() const {
  std::size_t size = 0;
  for (const CloudField& f : fields) size += static_cast<std::size_t>(f.size) * f.count;
  return size;
}

const CloudField* CloudFile::field(std::string_view name) const {
  const CloudField* alike = nullptr;
  int several = 0;
  for (const CloudField& f : fields) {
    if (f.name == name) return &f;
    if (!same_but_for_capitals(f.name, name)) continue;
    alike = &f;
    ++several;
  }
  return several == 1 ? alike : nullptr;
}

std::vector<float> CloudFile::column(std::string_view name) const {
  const CloudField* wanted = field(name);
  if (wanted == nullptr) return {};
  std::size_t offset = 0;
  for (const CloudField* f = fields.data(); f != wanted; ++f)
    offset += static_cast<std::size_t>(f->size) * f->count;
  const std::size_t stride = record_size();
  std::vector<float> values(points);
  for (std::size_t i = 0; i < points; ++i)
    values[i] = element(*wanted, records.data() + i * stride + offset);
  return values;
}

std::vector<float> CloudFile::intensity() const {
  for (const char* name : kIntensities)
    if (field(name) != nullptr) return column(name);
  return {};
}

float CloudFile::intensity_max() const {
  float brightest = 0;
  for (const float value : intensity())
    if (std::isfinite(value)) brightest = std::max(brightest, value);
  for (const float top : {1.0F, 255.0F, 65535.0F})
    if (brightest <= top) return top;
  return 1;
}

std::vector<float> CloudFile::xyz() const {
  const auto x = column("x"), y = column("y"), z = column("z");
  std::vector<float> rows;
  rows.reserve(3 * points);
  for (std::size_t i = 0; i < points; ++i) rows.insert(rows.end(), {x[i], y[i], z[i]});
  return rows;
}

Viewpoint CloudFile::pose() const {
  std::istringstream in(viewpoint);
  Viewpoint pose;
  in >> pose.shift.x >> pose.shift.y >> pose.shift.z >> pose.w >> pose.axis.x >> pose.axis.y >>
      pose.axis.z;
  const double length = std::sqrt(pose.w * pose.w + dot(pose.axis, pose.axis));
  if (length == 0) return {pose.shift, 1, {}};
  return {pose.shift, pose.w / length, 1 / length * pose.axis};
}

std::vector<float> CloudFile::moved_xyz() const {
  const Viewpoint pose = this->pose();
  if (pose.is_identity()) return xyz();
  const auto stored = xyz();
  std::vector<float> rows;
  rows.reserve(stored.size());
  for (std::size_t i = 0; i < stored.size(); i += 3) {
    const Vec3 v{stored[i], stored[i + 1], stored[i + 2]};
    const bool returned = v.x != 0 || v.y != 0 || v.z != 0;
    const Vec3 moved = returned ? pose.apply(v) : v;
    for (const double value : {moved.x, moved.y, moved.z})
      rows.push_back(static_cast<float>(value));
  }
  return rows;
}

bool Viewpoint::is_identity() const { return dot(shift, shift) == 0 && dot(axis, axis) == 0; }

bool Viewpoint::is_far() const {
  constexpr double kFarthestM = 10000;
  return std::max({std::abs(shift.x), std::abs(shift.y), std::abs(shift.z)}) >= kFarthestM;
}

Vec3 Viewpoint::apply(Vec3 v) const {
  const Vec3 turned = v + 2.0 * cross(axis, cross(axis, v) + w * v);
  return is_far() ? turned : turned + shift;
}

CloudFile CloudFile::select(std::span<const int> keep) const {
  CloudFile out{fields, viewpoint, encoding, keep.size(), {}};
  const std::size_t stride = record_size();
  out.records.reserve(keep.size() * stride);
  for (const int k : keep)
    out.records.append(records, static_cast<std::size_t>(k) * stride, stride);
  return out;
}

CloudFile parse_bin(std::string_view bytes, const std::string& name) {
  constexpr std::size_t kRecord = 16;
  if (bytes.size() % kRecord != 0)
    throw ConfigError(name +
                      ":1:1: (size): expected a multiple of 16 (float32 x y z intensity), got " +
                      std::to_string(bytes.size()) + " bytes");
  CloudFile cloud;
  for (const char* field : {"x", "y", "z", "intensity"}) cloud.fields.push_back({field});
  cloud.points = bytes.size() / kRecord;
  cloud.records = bytes;
  return cloud;
}

std::string bin_bytes(const CloudFile& cloud, float intensity_max) {
  const std::vector<float> xyz = cloud.moved_xyz();
  std::vector<float> intensity = cloud.intensity();
  intensity.resize(cloud.points);
  for (float& value : intensity) value /= intensity_max;
  return bin_records(xyz, intensity);
}

std::string bin_records(std::span<const float> xyz, std::span<const float> intensity) {
  std::string bytes(16 * intensity.size(), '\0');
  for (std::size_t i = 0; i < intensity.size(); ++i) {
    std::memcpy(&bytes[16 * i], &xyz[3 * i], 12);
    std::memcpy(&bytes[16 * i + 12], &intensity[i], 4);
  }
  return bytes;
}

CloudFile read_cloud(const std::filesystem::path& file) {
  const bool pcd = is_pcd(file);
  const std::string bytes = read_file(file);
  return pcd ? parse_pcd(bytes, file.string()) : parse_bin(bytes, file.string());
}

void write_cloud(const std::filesystem::path& file, const CloudFile& cloud, float intensity_max) {
  write_file_atomically(file, is_pcd(file) ? pcd_bytes(cloud) : bin_bytes(cloud, intensity_max));
}

}  // namespace infrasim
