#include "infrasim/config/lidar_tables.h"

#include <cmath>
#include <optional>
#include <set>

#include "infrasim/config/fields.h"
#include "infrasim/config/tree.h"
#include "infrasim/core/files.h"
#include "infrasim/io/csv.h"
#include "infrasim/io/npy.h"

namespace infrasim::config {

namespace {

// limit of azimuths, slightly above 2 pi, because float32 rounds 2 pi up
constexpr double kTurn = 2 * kPi + 1e-5;

constexpr double kLongestTable_s = 3600;
constexpr int kMostChannels = 100'000;

FiringTable read_csv_table(const std::filesystem::path& file) {
  constexpr std::string_view kDegrees = "azimuth_deg";
  std::string begin(kByteOrderMark.size() + kDegrees.size(), '\0');
  open_file(file).read(begin.data(), std::ssize(begin));
  if (begin.starts_with(kByteOrderMark)) begin.erase(0, kByteOrderMark.size());
  const bool in_degrees = begin.starts_with(kDegrees);
  const std::string_view azimuth = in_degrees ? "azimuth_deg" : "azimuth_rad";
  const std::string_view elevation = in_degrees ? "elevation_deg" : "elevation_rad";
  const double unit = in_degrees ? kPi / 180 : 1;
  CsvReader csv(file, std::string(azimuth) + "," + std::string(elevation), "time_s");
  FiringTable table;
  while (csv.next_row()) {
    Vec2& direction = table.directions.emplace_back();
    direction.x = unit * csv.number(azimuth, -kTurn / unit, kTurn / unit);
    direction.y = unit * csv.number(elevation, -kPi / 2 / unit, kPi / 2 / unit);
    if (!csv.has_last()) continue;
    table.times_s.push_back(csv.number("time_s", 0, kLongestTable_s));
    if (table.times_s.size() > 1 && table.times_s.back() < *(table.times_s.end() - 2))
      csv.fail("time_s", "expected a time that is not before the row above, got " +
                             number_text(table.times_s.back()));
  }
  return table;
}

FiringTable read_npy_table(const std::filesystem::path& file) {
  const NpyTable npy = read_npy(file, 2, 3);
  FiringTable table;
  const auto check = [&](bool is_good, const std::string& what) {
    if (!is_good) fail({file.string()}, "row " + std::to_string(table.directions.size() - 1), what);
  };
  for (std::size_t i = 0; i < npy.values.size(); i += npy.columns) {
    const double x = npy.values[i], y = npy.values[i + 1];
    table.directions.push_back({x, y});
    check(std::abs(x) <= kTurn && std::abs(y) <= kPi / 2,
          "expected radians, got a direction that is not finite or out of range");
    if (npy.columns < 3) continue;
    const double time = npy.values[i + 2];
    const double least = table.times_s.empty() ? 0 : table.times_s.back();
    check(time >= least && time <= kLongestTable_s,
          "time: expected " + number_text(least) + " to " + number_text(kLongestTable_s) +
              " s, and no time before that of the row above, got " + number_text(time));
    table.times_s.push_back(time);
  }
  return table;
}

/// Checks that the numbers of the channels have no gap and begin at 0 or 1.
void check_numbers(const std::set<int>& numbers, const std::filesystem::path& file) {
  if (numbers.empty()) fail({file.string(), 1, 1}, "(rows)", "expected one or more rows, got none");
  const int first = *numbers.begin(), last = *numbers.rbegin();
  const auto fail_numbers = [&](const std::string& what) {
    fail({file.string()}, "channel", what);
  };
  if (first > 1) fail_numbers("expected 0 or 1 as the first number, got " + std::to_string(first));
  for (int number = first; number <= last; ++number)
    if (!numbers.contains(number))
      fail_numbers("expected a row for each of " + std::to_string(first) + " to " +
                   std::to_string(last) + ", got none for " + std::to_string(number));
}

}  // namespace

std::vector<Channel> read_channels(const std::filesystem::path& file) {
  const std::string suffix = file.extension().string();
  if (suffix == ".json" || suffix == ".yaml" || suffix == ".yml" || suffix == ".xml")
    fail({file.string()}, "(file)",
         "expected a table of channels (.csv), to which `pyinfra lidars --from-table FILE --out "
         "LIDAR.yaml` converts Ouster's metadata (beam_altitude_angles) and Velodyne's calibration "
         "(vert_correction); got " +
             suffix);
  CsvReader csv(file, "channel,elevation_deg,azimuth_offset_deg,fire_time_us",
                "column_step,first_column,range_at_10_percent_m,min_range_m");
  const auto whole = [&](const char* key, int blank, int most) {
    const double value = csv.has(key) ? csv.number_or(blank, key, 0, most) : blank;
    if (value != std::round(value))
      csv.fail(key, "expected a whole number, got " + number_text(value));
    return static_cast<int>(value);
  };
  const auto metres = [&](const char* key, double most) -> std::optional<double> {
    const double value = csv.has(key) ? csv.number_or(-1, key, 0, most) : -1;
    return value < 0 ? std::nullopt : std::optional(value);
  };
  std::vector<Channel> channels;
  std::set<int> numbers;
  while (csv.next_row()) {
    const double number = csv.number("channel", 0, kMostChannels);
    if (number != std::round(number))
      csv.fail("channel", "expected a whole number, got " + number_text(number));
    if (!numbers.insert(static_cast<int>(number)).second)
      csv.fail("channel", "expected each channel once, got " + number_text(number) + " twice");
    Channel& channel = channels.emplace_back();
    channel.elevation_deg = csv.number("elevation_deg", -90, 90);
    channel.azimuth_offset_deg = csv.number_or(0, "azimuth_offset_deg", -180, 180);
    channel.fire_time_us = csv.number_or(0, "fire_time_us", 0, 1e6);
    channel.column_step = whole("column_step", 1, kMostColumnStep);
    if (channel.column_step == 0) csv.fail("column_step", "expected 1 or more, got 0");
    channel.first_column = whole("first_column", 0, kMostColumnStep);
    if (channel.first_column >= channel.column_step)
      csv.fail("first_column",
               "expected below column_step, got " + std::to_string(channel.first_column));
    channel.range_at_10_percent_m = metres("range_at_10_percent_m", kLongestPublishedRange_m);
    if (channel.range_at_10_percent_m == 0.0)
      csv.fail("range_at_10_percent_m", "expected above 0, got 0");
    channel.min_range_m = metres("min_range_m", kLongestMinRange_m);
  }
  check_numbers(numbers, file);
  return channels;
}

FiringTable read_firing_table(const std::filesystem::path& file) {
  FiringTable table = file.extension() == ".npy" ? read_npy_table(file) : read_csv_table(file);
  if (table.directions.empty())
    fail({file.string(), 1, 1}, "(rows)", "expected one or more rows, got none");
  if (!table.times_s.empty()) {
    const double first = table.times_s.front();
    for (double& time : table.times_s) time -= first;
  }
  return table;
}

}  // namespace infrasim::config
