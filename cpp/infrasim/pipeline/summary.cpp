#include "infrasim/pipeline/summary.h"

#include <algorithm>
#include <sstream>

namespace infrasim {

Summary::Summary(const std::vector<LidarConfig>& lidars) : computed_(lidars.size()) {
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

std::vector<SummaryRow> Summary::rows(int threads) const {
  std::vector<SummaryRow> rows = sums_;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    SummaryRow& row = rows[i];
    row.rays_cast_per_frame /= std::max(1, computed_[i]);
    const double frames = std::max(1, row.frames);
    row.rays_per_frame /= frames;
    row.hits_per_frame /= frames;
    row.vehicles_per_frame /= frames;
    row.vehicle_points_per_frame /= frames;
    row.seconds /= threads;
    row.mrays_per_s = row.seconds > 0 ? row.mrays_per_s / row.seconds : 0;
  }
  return rows;
}

std::string summary_csv(const std::vector<SummaryRow>& rows) {
  std::ostringstream text;
  text << "lidar,preset,frames,rays_per_frame,hits_per_frame,vehicles_per_frame,"
          "vehicle_points_per_frame,rays_cast_per_frame,seconds,mrays_per_s\n";
  for (const SummaryRow& r : rows)
    text << r.lidar << ',' << r.preset << ',' << r.frames << ',' << r.rays_per_frame << ','
         << r.hits_per_frame << ',' << r.vehicles_per_frame << ',' << r.vehicle_points_per_frame
         << ',' << r.rays_cast_per_frame << ',' << r.seconds << ',' << r.mrays_per_s << '\n';
  return text.str();
}

}  // namespace infrasim
