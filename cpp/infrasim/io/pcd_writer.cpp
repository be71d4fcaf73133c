#include <charconv>
#include <cstdint>
#include <cstring>
#include <limits>
#include <sstream>
#include <string>

#include "infrasim/core/errors.h"
#include "infrasim/io/cloud_file.h"
#include "infrasim/io/lzf.h"

// Writes PCD files, version 0.7.

namespace infrasim {

namespace {

void print_value(const CloudField& field, const char* at, std::string& out) {
  with_type(field, [&]<class T>(T value) {
    std::memcpy(&value, at, sizeof(T));
    char buffer[32];
    out.append(buffer, std::to_chars(buffer, buffer + sizeof(buffer), value).ptr);
  });
}

std::string ascii_rows(const CloudFile& cloud) {
  std::string out;
  const char* at = cloud.records.data();
  for (std::size_t i = 0; i < cloud.points; ++i) {
    const char* separator = "";
    for (const CloudField& f : cloud.fields)
      for (int j = 0; j < f.count; ++j, at += f.size) {
        out += separator;
        print_value(f, at, out);
        separator = " ";
      }
    out += '\n';
  }
  return out;
}

std::string compressed_columns(const CloudFile& cloud) {
  std::string columns;
  columns.reserve(cloud.records.size());
  const std::size_t stride = cloud.record_size();
  std::size_t offset = 0;
  for (const CloudField& f : cloud.fields) {
    const std::size_t width = static_cast<std::size_t>(f.size) * f.count;
    for (std::size_t i = 0; i < cloud.points; ++i)
      columns.append(cloud.records, i * stride + offset, width);
    offset += width;
  }
  if (columns.size() > std::numeric_limits<std::uint32_t>::max() / 2)
    throw ConfigError("binary_compressed: expected up to 2 GiB, got " +
                      std::to_string(columns.size()) + " bytes of points");
  const std::string packed = lzf_compress(columns);
  const std::uint32_t sizes[2] = {static_cast<std::uint32_t>(packed.size()),
                                  static_cast<std::uint32_t>(columns.size())};
  return std::string(reinterpret_cast<const char*>(sizes), sizeof(sizes)) + packed;
}

}  // namespace

std::string pcd_bytes(const CloudFile& cloud) {
  std::ostringstream header;
  std::string names, sizes, types, counts;
  for (const CloudField& f : cloud.fields) {
    names += " " + f.name;
    sizes += " " + std::to_string(f.size);
    types += std::string(" ") + f.type;
    counts += " " + std::to_string(f.count);
  }
  header << "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS" << names << "\nSIZE"
         << sizes << "\nTYPE" << types << "\nCOUNT" << counts << "\nWIDTH " << cloud.points
         << "\nHEIGHT 1\nVIEWPOINT " << cloud.viewpoint << "\nPOINTS " << cloud.points << "\nDATA ";
  switch (cloud.encoding) {
    case PcdEncoding::kAscii:
      return header.str() + "ascii\n" + ascii_rows(cloud);
    case PcdEncoding::kBinary:
      return header.str() + "binary\n" + cloud.records;
    case PcdEncoding::kBinaryCompressed:
      break;
  }
  return header.str() + "binary_compressed\n" + compressed_columns(cloud);
}

}  // namespace infrasim
