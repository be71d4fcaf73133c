#include "infrasim/pipeline/summary.h"

#include <algorithm>
#include <sstream>
#include <string_view>

#include "infrasim/core/files.h"
#include "infrasim/core/numbers.h"
#include "infrasim/io/atomic_file.h"
#include "infrasim/io/data_set.h"

namespace infrasim {

namespace {

constexpr std::string_view kSummaryHeader =
    "lidar,preset,frames,rays_per_frame,hits_per_frame,vehicles_per_frame,"
    "vehicle_points_per_frame,rays_cast_per_frame,seconds,mrays_per_s";

/// Formats a mean with up to six digits after the decimal point, and without an exponent.
std::string mean_text(double value) {
  std::string text = fixed_text(value, 6);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.ends_with('.')) text.pop_back();
  return text;
}

std::string line_of(const SummaryRow& r) {
  std::string text = r.lidar + "," + r.preset + "," + std::to_string(r.frames);
  for (const double mean :
       {r.rays_per_frame, r.hits_per_frame, r.vehicles_per_frame, r.vehicle_points_per_frame,
        r.rays_cast_per_frame, r.seconds, r.mrays_per_s})
    text += "," + mean_text(mean);
  return text;
}

/// Returns the last three cells of a line: rays cast, computing time and rays per second.
std::string_view times_of(std::string_view line) {
  std::size_t at = line.size();
  for (int cells = 0; cells < 3 && at != std::string_view::npos; ++cells)
    at = line.rfind(',', at - 1);
  return at == std::string_view::npos ? "" : line.substr(at);
}

/// Returns the lines of a folder's summary.csv whose LiDARs still have a folder. Returns no lines
/// if the file has another header.
std::vector<std::string> lines_in(const std::filesystem::path& folder) {
  std::vector<std::string> lines;
  if (!std::filesystem::exists(folder / "summary.csv")) return lines;
  std::istringstream text(unix_text(read_file(folder / "summary.csv")));
  std::string line;
  if (!std::getline(text, line) || line != kSummaryHeader) return lines;
  std::error_code ignored;  // a LiDAR's folder that can't be read counts as missing
  while (std::getline(text, line))
    if (std::filesystem::exists(folder / line.substr(0, line.find(',')) / "lidar.yaml", ignored))
      lines.push_back(line);
  return lines;
}

}  // namespace

Summary::Summary(const std::vector<LidarConfig>& lidars)
    : computed_(lidars.size()), others_(lidars.size()) {
  for (const LidarConfig& lidar : lidars) {
    SummaryRow& row = sums_.emplace_back();
    row.lidar = lidar.name;
    row.preset = lidar.preset;
  }
}

void Summary::add(const std::vector<FrameTally>& tallies) {
  for (std::size_t i = 0; i < tallies.size(); ++i) {
    const FrameTally& tally = tallies[i];
    const auto rays = static_cast<double>(tally.rays);
    SummaryRow& row = sums_[i];
    ++row.frames;
    row.rays_per_frame += rays;
    row.hits_per_frame += static_cast<double>(tally.counts.hits);
    row.vehicles_per_frame += static_cast<double>(tally.counts.vehicles);
    row.vehicle_points_per_frame += static_cast<double>(tally.counts.vehicle_points);
    row.seconds += tally.seconds;
    if (tally.seconds == 0) continue;
    ++computed_[i];
    row.rays_cast_per_frame += static_cast<double>(tally.rays_cast);
    row.mrays_per_s += rays * 1e-6;
    row.frames_without_plane += tally.no_plane ? 1 : 0;
  }
}

void Summary::add_others(const std::filesystem::path& folder, const std::vector<int>& frames) {
  for (std::size_t i = 0; i < sums_.size(); ++i) {
    SummaryRow& row = sums_[i];
    for (const int k : frames_on_disk(folder / row.lidar)) {
      if (std::ranges::binary_search(frames, k)) continue;
      const FrameCounts counts = read_counts(folder / row.lidar, k);
      ++row.frames;
      ++others_[i];
      row.hits_per_frame += static_cast<double>(counts.hits);
      row.vehicles_per_frame += static_cast<double>(counts.vehicles);
      row.vehicle_points_per_frame += static_cast<double>(counts.vehicle_points);
    }
  }
}

std::vector<SummaryRow> Summary::rows(int threads) const {
  std::vector<SummaryRow> rows = sums_;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    SummaryRow& row = rows[i];
    row.rays_cast_per_frame /= std::max(1, computed_[i]);
    const double frames = std::max(1, row.frames);
    row.rays_per_frame /= std::max(1, row.frames - others_[i]);
    row.hits_per_frame /= frames;
    row.vehicles_per_frame /= frames;
    row.vehicle_points_per_frame /= frames;
    row.seconds /= threads;
    row.mrays_per_s = row.seconds > 0 ? row.mrays_per_s / row.seconds : 0;
  }
  return rows;
}

std::string summary_csv(const std::vector<SummaryRow>& rows) {
  std::string text = std::string(kSummaryHeader) + "\n";
  for (const SummaryRow& row : rows) text += line_of(row) + "\n";
  return text;
}

void merge_summary(const std::filesystem::path& folder, Summary sums,
                   const std::vector<int>& frames, int threads) {
  const FolderLock lock(folder);
  sums.add_others(folder, frames);
  std::vector<std::string> lines = lines_in(folder);
  for (const SummaryRow& row : sums.rows(threads)) {
    const auto old = std::ranges::find_if(
        lines, [&](const std::string& line) { return line.starts_with(row.lidar + ","); });
    std::string line = line_of(row);
    if (old == lines.end()) {
      lines.push_back(line);
      continue;
    }
    if (row.seconds == 0)
      line = line.substr(0, line.size() - times_of(line).size()) += times_of(*old);
    *old = line;
  }
  std::string text = std::string(kSummaryHeader) + "\n";
  for (const std::string& line : lines) text += line + "\n";
  write_file_atomically(folder / "summary.csv", text);
}

}  // namespace infrasim
