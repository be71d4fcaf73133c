#include "infrasim/pipeline/run.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <span>
#include <utility>

#include "infrasim/io/atomic_file.h"
#include "infrasim/pipeline/frame_writer.h"
#include "infrasim/pipeline/fusion.h"
#include "infrasim/pipeline/run_folder.h"
#include "infrasim/pipeline/scheduler.h"
#include "infrasim/sensor/pattern_period.h"

namespace infrasim {

namespace {

void check(const RunRequest& request) {
  const auto frames = frame_count(request.scene.duration_s, period_s(request.lidars));
  const FrameRange& f = request.frames;
  if (f.first < 0 || f.step < 1 || f.last <= f.first || f.last > frames)
    throw ConfigError("--frames: expected A:B[:STEP] within 0:" + std::to_string(frames) +
                      ", got " + std::to_string(f.first) + ":" + std::to_string(f.last) + ":" +
                      std::to_string(f.step));
  for (const LidarConfig& lidar : request.lidars)
    if (request.cast_all && request.scene.static_layers &&
        request.scene.static_layers->contains(lidar.name))
      throw ConfigError("--cast-all: expected a scene without static_layers, got static_layers." +
                        lidar.name + ": the static points of a file cannot be cast");
  std::set<std::string> names;
  for (const LidarConfig& lidar : request.lidars)
    if (!names.insert(lidar.name).second)
      throw ConfigError("--lidar: expected each LiDAR once, got '" + lidar.name + "' twice");
}

/// @throws ConfigError if fused frames are requested but not possible
void check_fuse(const RunRequest& request) {
  if (!request.fuse) return;
  if (request.scene.mounts.size() < 2)
    throw ConfigError("--fuse: expected several mounts, got a scene with one");
  if (!request.mount.empty())
    throw ConfigError("--fuse: expected several mounts, got --mount " + request.mount);
  if (request.out.empty()) throw ConfigError("--fuse: expected --out, got none");
}

/// Returns the parts of a run, each with its own folder: one per mount, then one for the fused
/// frames if these are requested.
std::vector<RunRequest> parts_of(const RunRequest& request, const std::vector<World>& worlds) {
  const bool several = request.scene.mounts.size() > 1;
  std::vector<RunRequest> parts;
  const auto add = [&](const SceneConfig& scene, const std::string& folder) {
    RunRequest& part = parts.emplace_back(request);
    part.scene = scene;
    part.mount = folder;
    if (!request.out.empty()) part.out /= folder;
  };
  for (const World& world : worlds)
    add(world.scene, several ? world.scene.mounts.begin()->first : "");
  if (request.fuse) add(request.scene, kFusedName);
  return parts;
}

void open_folders(const RunRequest& request, const std::vector<RunRequest>& parts,
                  const std::vector<World>& worlds, const std::optional<Fusion>& fusion) {
  if (request.out.empty()) return;
  const auto lone = request.out / "dataset.yaml";
  if (request.scene.mounts.size() > 1 && std::filesystem::exists(lone))
    throw IoError(lone.string() +
                  ": expected another folder, got one that holds a run of one mount");
  for (std::size_t m = 0; m < worlds.size(); ++m) open_run_folder(parts[m], worlds[m]);
  if (fusion) open_fused_folder(parts.back(), worlds.front(), *fusion);
}

/// Returns, for each LiDAR, whether frame k is missing on disk.
std::vector<bool> missing(const RunRequest& part, int k) {
  std::vector<bool> out;
  for (const LidarConfig& lidar : part.lidars)
    out.push_back(part.out.empty() ||
                  !std::filesystem::exists(velodyne_file(part.out / lidar.name, k)));
  return out;
}

FrameTally tally_of(const Frame& frame) {
  return {count(frame), frame.rays, frame.rays_cast, frame.no_plane, frame.seconds};
}

/// Counts of one frame: for each part of the run, one entry per LiDAR.
using Tallies = std::vector<std::vector<FrameTally>>;

/// Computes the files of one frame that are missing on disk, and queues them for writing.
class FrameWork {
 public:
  FrameWork(const std::vector<RunRequest>& parts, const std::optional<Fusion>& fusion,
            FrameWriter& writer)
      : parts_(parts), fusion_(fusion), writer_(writer) {}

  Tallies operator()(std::span<FrameSimulator> simulators, int k) const {
    const std::size_t lidars = parts_.front().lidars.size();
    const std::vector<bool> fuse =
        fusion_ ? missing(parts_.back(), k) : std::vector<bool>(lidars, false);
    std::vector<std::vector<Frame>> frames;
    std::vector<std::vector<bool>> absent;
    Tallies tallies;
    for (std::size_t m = 0; m < simulators.size(); ++m) {
      absent.push_back(missing(parts_[m], k));
      tallies.push_back(at_mount(parts_[m], simulators[m], k, absent[m], fuse, frames));
    }
    if (fusion_) tallies.push_back(fused(frames, k, fuse));
    for (std::size_t m = 0; m < simulators.size(); ++m)
      for (std::size_t i = 0; i < lidars; ++i)
        if (absent[m][i]) write_later(parts_[m], i, k, std::move(frames[m][i]));
    return tallies;
  }

 private:
  /// @param absent whether the frame of each LiDAR is missing on disk
  /// @param fuse   whether each LiDAR is computed even if its frame exists on disk, because fused
  ///   frames are made from computed frames and not from files
  static std::vector<FrameTally> at_mount(const RunRequest& part, FrameSimulator& simulator, int k,
                                          const std::vector<bool>& absent,
                                          const std::vector<bool>& fuse,
                                          std::vector<std::vector<Frame>>& frames) {
    std::vector<bool> wanted = absent;
    for (std::size_t i = 0; i < fuse.size(); ++i) wanted[i] = wanted[i] || fuse[i];
    const auto& made = frames.emplace_back(simulator.simulate(k, wanted));
    std::vector<FrameTally> tallies;
    for (std::size_t i = 0; i < made.size(); ++i) {
      tallies.push_back(tally_of(made[i]));
      if (!wanted[i]) tallies[i].counts = read_counts(part.out / part.lidars[i].name, k);
    }
    return tallies;
  }

  std::vector<FrameTally> fused(const std::vector<std::vector<Frame>>& frames, int k,
                                const std::vector<bool>& fuse) const {
    const RunRequest& part = parts_.back();
    std::vector<FrameTally> tallies;
    for (std::size_t i = 0; i < fuse.size(); ++i) {
      std::vector<const Frame*> of_lidar;
      for (const std::vector<Frame>& at_mount : frames) of_lidar.push_back(&at_mount[i]);
      const auto folder = part.out / part.lidars[i].name;
      FusedFrame whole = fusion_->fuse(k, of_lidar);
      tallies.push_back(tally_of(whole.frame));
      if (!fuse[i]) {
        tallies[i].counts = read_counts(folder, k);
        tallies[i].seconds = 0;
        continue;
      }
      write_later(part, i, k, std::move(whole.frame), std::move(whole.mount));
    }
    return tallies;
  }

  /// @param mounts mount index of each point of a fused frame
  void write_later(const RunRequest& part, std::size_t lidar, int k, Frame frame,
                   std::optional<std::vector<std::uint16_t>> mounts = std::nullopt) const {
    if (part.out.empty()) return;
    writer_.write([&part, folder = part.out / part.lidars[lidar].name, k, frame = std::move(frame),
                   mounts = std::move(mounts)] {
      if (mounts && part.scene.point_fields) write_point_mounts(folder, k, *mounts);
      write_frame(folder, k, frame,
                  {.all_labels = part.scene.labels == LabelRule::kAll,
                   .label_time = label_time_of(part.scene, part.preset),
                   .point_fields = part.scene.point_fields});
    });
  }

  const std::vector<RunRequest>& parts_;
  const std::optional<Fusion>& fusion_;
  FrameWriter& writer_;
};

constexpr int kFramesToSeeOne = 10;

/// Warns of each LiDAR that has had no point on a vehicle so far, if the scene has traffic.
void warn_of_no_vehicles(const SceneConfig& scene, const std::vector<SummaryRow>& rows,
                         const Warn& warn) {
  if (scene.traffic && scene.traffic->vehicles_per_km_lane == 0) return;
  for (const SummaryRow& row : rows)
    if (row.vehicle_points_per_frame == 0)
      warn("no-vehicle-points: " + row.lidar +
           ": expected points on vehicles, got none in the first " + std::to_string(row.frames) +
           " frames");
}

void warn_without_plane(const std::vector<SummaryRow>& rows, const Warn& warn) {
  for (const SummaryRow& row : rows)
    if (row.frames_without_plane > 0)
      warn("no-ground-plane: " + row.lidar +
           ": expected a road at sensor_height_m below the sensor, got no plane in " +
           std::to_string(row.frames_without_plane) + " of " + std::to_string(row.frames) +
           " frames; these frames keep all points");
}

/// The summaries of a run: one per mount, and one for the fused frames.
class Summaries {
 public:
  explicit Summaries(const std::vector<RunRequest>& parts) : parts_(parts) {
    for (const RunRequest& part : parts) sums_.emplace_back(part.lidars);
  }
  void add(const Tallies& tallies) {
    for (std::size_t i = 0; i < sums_.size(); ++i) sums_[i].add(tallies[i]);
  }
  /// @param frames requested frames, ascending; other frames in the folders are counted too
  void write(int threads, const std::vector<int>& frames) const {
    for (std::size_t i = 0; i < sums_.size(); ++i)
      if (const RunRequest& part = parts_[i]; !part.out.empty())
        merge_summary(part.out, sums_[i], frames, threads);
  }
  std::vector<SummaryRow> rows(int threads) const {
    std::vector<SummaryRow> out;
    for (std::size_t i = 0; i < sums_.size(); ++i)
      for (SummaryRow& row : sums_[i].rows(threads)) {
        if (!parts_[i].mount.empty()) row.lidar = parts_[i].mount + "/" + row.lidar;
        out.push_back(std::move(row));
      }
    return out;
  }

 private:
  const std::vector<RunRequest>& parts_;
  std::vector<Summary> sums_;
};

std::vector<std::string> mounts_of(const RunRequest& request) {
  if (!request.mount.empty()) return {request.mount};
  return mount_names(request.scene);
}

}  // namespace

std::vector<int> frame_numbers(const FrameRange& range) {
  std::vector<int> frames;
  // The frame number has 64 bits, because the step may be INT_MAX.
  for (std::int64_t k = range.first; k < range.last; k += range.step)
    frames.push_back(static_cast<int>(k));
  return frames;
}

std::vector<SummaryRow> run(const RunRequest& request, const std::atomic<int>& stop,
                            const Progress& progress, const Warn& warn) {
  check(request);
  check_fuse(request);
  const FrameRange& range = request.frames;
  for (const std::string& line :
       period_warnings(request.lidars, range.first, range.last, range.step))
    warn(line);
  const double frame_s = period_s(request.lidars);
  const std::vector<int> frames = frame_numbers(request.frames);
  const std::vector<World> worlds =
      build_worlds(request.scene, mounts_of(request), frames, frame_s);
  for (const std::string& line : worlds.front().warnings) warn(line);
  const std::vector<RunRequest> parts = parts_of(request, worlds);
  std::optional<Fusion> fusion;
  if (request.fuse) fusion.emplace(request.scene, worlds, frame_s);
  open_folders(request, parts, worlds, fusion);
  const auto total = frames.size();
  FrameWriter writer(static_cast<std::size_t>(request.threads));
  Scheduler<Tallies> scheduler(worlds, request.lidars,
                               {.frames = frames,
                                .threads = request.threads,
                                .ahead = total,
                                .stop = &stop,
                                .cast_all = request.cast_all},
                               FrameWork(parts, fusion, writer));
  Summaries summaries(parts);
  for (int done = 1; const auto frame = scheduler.next(); ++done) {
    summaries.add(frame->second);
    if (done == std::min<int>(kFramesToSeeOne, static_cast<int>(total)))
      warn_of_no_vehicles(request.scene, summaries.rows(1), warn);
    progress(done, static_cast<int>(total));
  }
  writer.finish();
  std::vector<SummaryRow> rows = summaries.rows(scheduler.threads());
  warn_without_plane(rows, warn);
  if (stop == 0) summaries.write(scheduler.threads(), frames);
  return rows;
}

}  // namespace infrasim
