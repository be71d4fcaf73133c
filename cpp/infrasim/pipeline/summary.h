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
  double rays_cast_per_frame = 0;  ///< mean number of rays cast in frames computed in this run
  double seconds =
      0;  ///< computing time of all frames, summed over threads, divided by the number of threads
  /// number of computed frames in which a `ground_plane` filter found no plane
  int frames_without_plane = 0;
  double mrays_per_s = 0;  ///< millions of rays per second of computing time
};

/// The counts of one frame of one LiDAR, which are added to the LiDAR's row.
struct FrameTally {
  FrameCounts counts;
  std::size_t rays = 0;
  std::size_t rays_cast = 0;
  bool no_plane = false;
  double seconds = 0;  ///< computing time; 0 if the frame was on disk before
};

/// Sums up the frames of a run, with one row per LiDAR.
class Summary {
 public:
  explicit Summary(const std::vector<LidarConfig>& lidars);
  /// @param tallies counts of one frame, one entry per LiDAR
  void add(const std::vector<FrameTally>& tallies);
  /// Adds the frames of a folder whose numbers are not in `frames`. The numbers of rays of these
  /// frames are unknown.
  void add_others(const std::filesystem::path& folder, const std::vector<int>& frames);
  /// Returns one row per LiDAR with means over the frames so far.
  /// @param threads number of threads that cast at the same time
  std::vector<SummaryRow> rows(int threads) const;

 private:
  std::vector<int> computed_;  ///< number of frames computed in this run, by LiDAR
  std::vector<int> others_;    ///< number of frames that were not requested, by LiDAR
  /// sums over frames; mrays_per_s is the number of rays in millions
  std::vector<SummaryRow> sums_;
};

std::string summary_csv(const std::vector<SummaryRow>& rows);

/// Merges the rows of a run into a folder's summary.csv, where they replace the rows of the same
/// LiDARs. Rows of other LiDARs are kept as long as their folders exist. If no frame of a LiDAR was
/// computed, the times in its row do not change. Frames on disk that were not requested are counted
/// too. Several processes may call this function at the same time, because it locks the folder.
/// @param frames requested frames, ascending
/// @param threads number of threads that cast at the same time
/// @throws IoError if the file can't be written
void merge_summary(const std::filesystem::path& folder, Summary sums,
                   const std::vector<int>& frames, int threads);

}  // namespace infrasim
