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
  double rays_cast_per_frame = 0;  ///< mean over the frames that were not on disk before
  double seconds =
      0;  ///< computing time of all frames, summed over threads and divided by their number
  /// computed frames in which a `ground_plane` filter found no plane
  int frames_without_plane = 0;
  double mrays_per_s = 0;  ///< millions of rays per second of computing time
};

/// The contribution of one frame of one LiDAR to its row.
struct FrameTally {
  FrameCounts counts;
  std::size_t rays = 0;
  std::size_t rays_cast = 0;
  bool no_plane = false;
  double seconds = 0;  ///< 0 if the frame was on disk before
};

/// Sums up a run, with one row per LiDAR.
class Summary {
 public:
  explicit Summary(const std::vector<LidarConfig>& lidars);
  /// @param tallies one per LiDAR
  void add(const std::vector<FrameTally>& tallies);
  /// Adds frames of a folder that were not requested. Their numbers of rays are unknown.
  void add_others(const std::filesystem::path& folder, const std::vector<int>& frames);
  /// Returns one row per LiDAR with means over the frames so far.
  /// @param threads number of threads that cast at the same time
  std::vector<SummaryRow> rows(int threads) const;

 private:
  std::vector<int> computed_;     ///< frames of each LiDAR that were not on disk before
  std::vector<int> others_;       ///< frames of each LiDAR that were not requested
  std::vector<SummaryRow> sums_;  ///< here mrays_per_s is the sum of rays, in millions
};

std::string summary_csv(const std::vector<SummaryRow>& rows);

/// Merges the rows of a run into a folder's summary.csv. They replace the rows of the same LiDARs.
/// Rows of other LiDARs are kept as long as their folders exist. If no frame of a LiDAR was
/// computed, the times in its row do not change. Frames on disk that were not requested are counted
/// too. Several processes may call this function at the same time, because it locks the folder.
/// @param frames requested frames, ascending
/// @param threads number of threads that cast at the same time
/// @throws IoError if it can't be written
void merge_summary(const std::filesystem::path& folder, Summary sums,
                   const std::vector<int>& frames, int threads);

}  // namespace infrasim
