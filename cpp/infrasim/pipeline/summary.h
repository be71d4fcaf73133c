#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "infrasim/config/lidar_config.h"
#include "infrasim/io/kitti.h"

namespace infrasim {

/// One row of summary.csv.
struct SummaryRow {
  std::string lidar;
  std::string preset;
  int frames = 0;
  double rays_per_frame = 0;
  double hits_per_frame = 0;
  double vehicles_per_frame = 0;
  double vehicle_points_per_frame = 0;
  double rays_cast_per_frame = 0;  ///< over the frames that were not on disk already
  double seconds =
      0;  ///< from vehicles and rays to columns, summed over threads and divided by them
  int frames_without_plane = 0;  ///< where a `ground_plane` filter found none; of those computed
  double mrays_per_s = 0;        ///< millions of rays answered per such second
};

/// What one frame of one LiDAR adds to its row.
struct FrameTally {
  FrameCounts counts;
  std::size_t rays = 0;
  std::size_t rays_cast = 0;
  bool no_plane = false;
  double seconds = 0;  ///< 0 if the frame was on disk already
};

/// Sums up a run, one row per LiDAR.
class Summary {
 public:
  explicit Summary(const std::vector<LidarConfig>& lidars);
  /// @param tallies one per LiDAR
  void add(const std::vector<FrameTally>& tallies);
  /// Adds the frames in a folder that were not asked for; how many rays they have is not known.
  void add_others(const std::filesystem::path& folder, const std::vector<int>& frames);
  /// Means over the frames so far.
  /// @param threads that cast at the same time
  std::vector<SummaryRow> rows(int threads) const;

 private:
  std::vector<int> computed_;     ///< frames of each LiDAR that were not on disk already
  std::vector<int> others_;       ///< and those that were not asked for
  std::vector<SummaryRow> sums_;  ///< mrays_per_s: millions of rays answered
};

std::string summary_csv(const std::vector<SummaryRow>& rows);

/// Puts the rows of a run into a folder's summary.csv: in place of those of the same LiDARs, or
/// behind the others, which stay as long as their LiDAR is there. A LiDAR of which nothing was
/// computed keeps the times of its row. Frames on disk that were not asked for count as well.
/// Other processes may do the same at the same time: frames are counted under the folder's lock.
/// @param frames that were asked for, ascending
/// @param threads that cast at the same time
/// @throws IoError if it can't be written
void merge_summary(const std::filesystem::path& folder, Summary sums,
                   const std::vector<int>& frames, int threads);

}  // namespace infrasim
