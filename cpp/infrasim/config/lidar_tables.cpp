#include "infrasim/config/lidar_tables.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <sstream>

#include "infrasim/config/tree.h"
#include "infrasim/core/files.h"

namespace infrasim::config {

namespace {

constexpr double kTurn = 2 * kPi + 1e-5;  // float32 rounds 2 pi up
constexpr std::size_t kMaxRows = 50'000'000;

/// Calls row(line number, cells) for each line under an expected header.
template <class Row>
void for_each_row(const std::filesystem::path& file, const std::string& header, const Row& row) {
  std::istringstream in(read_file(file));
  std::string line;
  std::getline(in, line);
  if (!line.empty() && line.back() == '\r') line.pop_back();
  if (line != header)
    fail({file.string(), 1, 1}, "(header)",
         "found '" + line.substr(0, 80) + "', allowed '" + header + "'");
  const auto columns = std::ranges::count(header, ',') + 1;
  for (int number = 2; std::getline(in, line); ++number) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (std::ranges::count(line, ',') + 1 != columns)
      fail({file.string(), number, 1}, "(row)",
           "found '" + line.substr(0, 80) + "', allowed " + std::to_string(columns) + " columns");
    std::vector<std::string> cells;
    std::istringstream parts(line);
    for (std::string cell; std::getline(parts, cell, ',');) cells.push_back(cell);
    cells.resize(static_cast<std::size_t>(columns));
    row(number, cells);
  }
}

double number(const std::filesystem::path& file, int line, const std::string& key,
              const std::string& cell, double low, double high) {
  double value = 0;
  const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
  if (error != std::errc{} || end != cell.data() + cell.size() || !(value >= low && value <= high))
    fail({file.string(), line, 1}, key,
         "found '" + cell.substr(0, 40) + "', allowed a number from " + std::to_string(low) +
             " to " + std::to_string(high));
  return value;
}

std::vector<Vec2> read_directions_csv(const std::filesystem::path& file) {
  std::vector<Vec2> rows;
  for_each_row(file, "azimuth_rad,elevation_rad", [&](int line, const auto& cells) {
    rows.push_back({number(file, line, "azimuth_rad", cells[0], -kTurn, kTurn),
                    number(file, line, "elevation_rad", cells[1], -kPi / 2, kPi / 2)});
  });
  return rows;
}

/// The text of a header entry such as `'descr': '<f4'` up to the next comma.
std::string npy_entry(const std::string& header, const std::string& name) {
  const auto at = header.find("'" + name + "':");
  if (at == std::string::npos) return "";
  const auto begin = header.find_first_not_of(' ', at + name.size() + 3);
  if (begin == std::string::npos) return "";
  const auto end = header[begin] == '(' ? header.find(')', begin) + 1 : header.find(',', begin);
  return header.substr(begin, end - begin);
}

/// Format: NumPy enhancement proposal 1 (version 1 and 2 headers).
std::vector<Vec2> read_directions_npy(const std::filesystem::path& file) {
  const std::string bytes = read_file(file);
  const Place place{file.string(), 1, 1};
  const auto reject = [&](const std::string& what) {
    fail(place, "(npy)", what + ", allowed a C-ordered (n, 2) array of <f4 or <f8");
  };
  if (bytes.size() < 12 || bytes.compare(0, 6, "\x93NUMPY") != 0) reject("found no NumPy header");
  const bool wide = bytes[6] >= 2;
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(bytes[i]); };
  std::size_t length = byte(8) + 256U * byte(9);
  if (wide) length += 65536U * byte(10) + 16777216U * byte(11);
  const std::size_t start = (wide ? 12U : 10U) + length;
  if (start > bytes.size()) reject("found a truncated header");
  const std::string header = bytes.substr(wide ? 12 : 10, length);
  const std::string type = npy_entry(header, "descr");
  const std::string shape = npy_entry(header, "shape");
  if (type != "'<f4'" && type != "'<f8'") reject("found type " + type);
  if (npy_entry(header, "fortran_order") != "False") reject("found Fortran order");
  std::size_t rows = 0;
  const auto [end, error] = std::from_chars(shape.data() + 1, shape.data() + shape.size(), rows);
  if (shape.empty() || error != std::errc{} ||
      std::string(end, shape.data() + shape.size()) != ", 2)" || rows > kMaxRows)
    reject("found shape " + shape);
  const std::size_t size = type == "'<f4'" ? 4 : 8;
  if (bytes.size() - start != rows * 2 * size) reject("found a size that is not the shape's");
  std::vector<Vec2> out(rows);
  const auto value = [&](std::size_t i) {
    const char* at = bytes.data() + start + i * size;
    float narrow = 0;
    double full = 0;
    std::memcpy(size == 4 ? static_cast<void*>(&narrow) : &full, at, size);
    return size == 4 ? static_cast<double>(narrow) : full;
  };
  for (std::size_t i = 0; i < rows; ++i) {
    out[i] = {value(2 * i), value(2 * i + 1)};
    if (!(std::abs(out[i].x) <= kTurn) || !(std::abs(out[i].y) <= kPi / 2))
      fail({file.string()}, "row " + std::to_string(i),
           "found a direction that is not finite or out of range, allowed radians");
  }
  return out;
}

}  // namespace

std::vector<Channel> read_channels(const std::filesystem::path& file) {
  std::vector<Channel> channels;
  const auto optional = [&](int line, const char* key, const std::string& cell, double low,
                            double high) {
    return cell.empty() ? 0.0 : number(file, line, key, cell, low, high);
  };
  for_each_row(file, "channel,elevation_deg,azimuth_offset_deg,fire_time_us",
               [&](int line, const auto& cells) {
                 channels.push_back({number(file, line, "elevation_deg", cells[1], -90, 90),
                                     optional(line, "azimuth_offset_deg", cells[2], -180, 180),
                                     optional(line, "fire_time_us", cells[3], 0, 1e6)});
               });
  if (channels.empty()) fail({file.string(), 1, 1}, "(rows)", "found none, allowed at least one");
  return channels;
}

std::vector<Vec2> read_directions(const std::filesystem::path& file) {
  auto rows = file.extension() == ".npy" ? read_directions_npy(file) : read_directions_csv(file);
  if (rows.empty()) fail({file.string(), 1, 1}, "(rows)", "found none, allowed at least one");
  return rows;
}

}  // namespace infrasim::config
