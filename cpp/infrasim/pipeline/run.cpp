#include "infrasim/pipeline/run.h"

#include <cmath>
#include <set>

#include "infrasim/io/atomic_file.h"
#include "infrasim/pipeline/run_folder.h"
#include "infrasim/pipeline/scheduler.h"

namespace infrasim {

namespace {

void check(const RunRequest& request) {
  const auto frames = static_cast<int>(std::llround(request.scene.duration_s / kFramePeriod));
  const FrameRange& f = request.frames;
  if (f.first < 0 || f.step < 1 || f.last <= f.first || f.last > frames)
    throw ConfigError("--frames: found " + std::to_string(f.first) + ":" + std::to_string(f.last) +
                      ":" + std::to_string(f.step) +
                      ", allowed A:B[:STEP] within 0:" + std::to_string(frames));
  for (const LidarConfig& lidar : request.lidars)
    if (request.cast_all && request.scene.static_layers &&
        request.scene.static_layers->contains(lidar.name))
      throw ConfigError("--cast-all: found static_layers." + lidar.name +
                        ", allowed a scene without it: what a file holds can't be cast");
  std::set<std::string> names;
  for (const LidarConfig& lidar : request.lidars)
    if (!names.insert(lidar.name).second)
      throw ConfigError("--lidar: found '" + lidar.name + "' twice, allowed once");
}

std::vector<int> numbers(const FrameRange& range) {
  std::vector<int> frames;
  for (std::int64_t k = range.first; k < range.last; k += range.step)  // a step may be INT_MAX
    frames.push_back(static_cast<int>(k));
  return frames;
}

bool on_disk(const RunRequest& request, const std::string& lidar, int k) {
  return !request.out.empty() && std::filesystem::exists(velodyne_file(request.out / lidar, k));
}

/// Computes and writes what is not on disk of one frame.
std::vector<FrameTally> do_frame(const RunRequest& request, FrameSimulator& simulator, int k) {
  std::vector<bool> wanted;
  for (const LidarConfig& lidar : request.lidars)
    wanted.push_back(!on_disk(request, lidar.name, k));
  const std::vector<Frame> frames = simulator.simulate(k, wanted);
  std::vector<FrameTally> tallies;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const auto folder = request.out / request.lidars[i].name;
    if (wanted[i] && !request.out.empty())
      write_frame(folder, k, frames[i],
                  {.all_labels = request.scene.labels == LabelRule::kAll,
                   .label_time = label_time_of(request.scene, request.preset),
                   .point_fields = request.scene.point_fields});
    tallies.push_back({wanted[i] ? count(frames[i]) : read_counts(folder, k), frames[i].rays,
                       frames[i].rays_cast, frames[i].no_plane, frames[i].seconds});
  }
  return tallies;
}

constexpr int kFramesToSeeOne = 10;

/// Vehicles are wanted, but none of a LiDAR's frames so far has a point on one.
void warn_of_no_vehicles(const SceneConfig& scene, const std::vector<SummaryRow>& rows,
                         const Warn& warn) {
  if (scene.traffic && scene.traffic->vehicles_per_km_lane == 0) return;
  for (const SummaryRow& row : rows)
    if (row.vehicle_points_per_frame == 0)
      warn("no-vehicle-points: " + row.lidar + ": found no point on a vehicle in the first " +
           std::to_string(row.frames) + " frames, allowed a mount that looks at the traffic");
}

void warn_without_plane(const std::vector<SummaryRow>& rows, const Warn& warn) {
  for (const SummaryRow& row : rows)
    if (row.frames_without_plane > 0)
      warn("no-ground-plane: " + row.lidar + ": found no plane in " +
           std::to_string(row.frames_without_plane) + " of " + std::to_string(row.frames) +
           " frames, kept all their points; allowed a road at sensor_height_m below the sensor");
}

}  // namespace

std::vector<SummaryRow> run(const RunRequest& request, const std::atomic<int>& stop,
                            const Progress& progress, const Warn& warn) {
  check(request);
  const World world = build_world(request.scene);
  if (!request.out.empty()) open_run_folder(request, world);
  const std::vector<int> frames = numbers(request.frames);
  const auto total = frames.size();
  Scheduler<std::vector<FrameTally>> scheduler(
      world, request.lidars,
      {.frames = frames,
       .threads = request.threads,
       .ahead = total,
       .stop = &stop,
       .cast_all = request.cast_all},
      [&](FrameSimulator& simulator, int k) { return do_frame(request, simulator, k); });
  Summary summary(request.lidars);
  for (int done = 1; const auto frame = scheduler.next(); ++done) {
    summary.add(frame->second);
    if (done == std::min<int>(kFramesToSeeOne, static_cast<int>(total)))
      warn_of_no_vehicles(request.scene, summary.rows(1), warn);
    progress(done, static_cast<int>(total));
  }
  std::vector<SummaryRow> rows = summary.rows(scheduler.threads());
  warn_without_plane(rows, warn);
  if (!request.out.empty() && stop == 0)
    write_file_atomically(request.out / "summary.csv", summary_csv(rows));
  return rows;
}

}  // namespace infrasim
