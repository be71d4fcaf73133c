#include "infrasim/config/lidar_tables.h"

#include <cmath>

#include "infrasim/config/tree.h"
#include "infrasim/io/csv.h"
#include "infrasim/io/npy.h"

namespace infrasim::config {

namespace {

constexpr double kTurn = 2 * kPi + 1e-5;  // float32 rounds 2 pi up

std::vector<Vec2> read_directions_csv(const std::filesystem::path& file) {
  CsvReader csv(file, "azimuth_rad,elevation_rad");
  std::vector<Vec2> directions;
  while (csv.next_row()) {
    const double azimuth = csv.number("azimuth_rad", -kTurn, kTurn);
    directions.push_back({azimuth, csv.number("elevation_rad", -kPi / 2, kPi / 2)});
  }
  return directions;
}

std::vector<Vec2> read_directions_npy(const std::filesystem::path& file) {
  const std::vector<double> values = read_npy(file, 2);
  std::vector<Vec2> directions;
  for (std::size_t i = 0; i < values.size(); i += 2) {
    directions.push_back({values[i], values[i + 1]});
    if (!(std::abs(values[i]) <= kTurn) || !(std::abs(values[i + 1]) <= kPi / 2))
      fail({file.string()}, "row " + std::to_string(i / 2),
           "found a direction that is not finite or out of range, allowed radians");
  }
  return directions;
}

}  // namespace

std::vector<Channel> read_channels(const std::filesystem::path& file) {
  CsvReader csv(file, "channel,elevation_deg,azimuth_offset_deg,fire_time_us");
  std::vector<Channel> channels;
  while (csv.next_row()) {
    csv.cell();
    Channel& channel = channels.emplace_back();
    channel.elevation_deg = csv.number("elevation_deg", -90, 90);
    channel.azimuth_offset_deg = csv.number_or(0, "azimuth_offset_deg", -180, 180);
    channel.fire_time_us = csv.number_or(0, "fire_time_us", 0, 1e6);
  }
  if (channels.empty()) fail({file.string(), 1, 1}, "(rows)", "found none, allowed at least one");
  return channels;
}

std::vector<Vec2> read_directions(const std::filesystem::path& file) {
  auto rows = file.extension() == ".npy" ? read_directions_npy(file) : read_directions_csv(file);
  if (rows.empty()) fail({file.string(), 1, 1}, "(rows)", "found none, allowed at least one");
  return rows;
}

}  // namespace infrasim::config
