#include "infrasim/pipeline/run.h"

#include <algorithm>
#include <exception>
#include <fstream>
#include <mutex>
#include <set>
#include <span>
#include <sstream>
#include <thread>

#include "infrasim/config/fields.h"
#include "infrasim/core/version.h"
#include "infrasim/io/data_set.h"
#include "infrasim/io/kitti.h"
#include "infrasim/pipeline/simulate.h"
#include "infrasim/sensor/pattern_table.h"

namespace infrasim {

namespace {

void check(const RunRequest& request) {
  const auto frames = static_cast<int>(std::llround(request.scene.duration_s / kFramePeriod));
  const FrameRange& f = request.frames;
  if (f.first < 0 || f.step < 1 || f.last <= f.first || f.last > frames)
    throw ConfigError("--frames: found " + std::to_string(f.first) + ":" + std::to_string(f.last) +
                      ":" + std::to_string(f.step) +
                      ", allowed A:B[:STEP] within 0:" + std::to_string(frames));
  std::set<std::string> names;
  for (const LidarConfig& lidar : request.lidars)
    if (!names.insert(lidar.name).second)
      throw ConfigError("--lidar: found '" + lidar.name + "' twice, allowed once");
}

std::string run_text(const RunRequest& request) {
  return dump_scene(request.scene) + "preset: \"" + request.preset + "\"\nversion: \"" +
         std::string(version()) + "\"\n";
}

/// The LiDAR's configuration and what follows from it, for readers that know no scene.
std::string lidar_text(const RunRequest& request, const LidarConfig& lidar) {
  const MountConfig& mount = request.scene.mounts.begin()->second;
  std::ostringstream text;
  text << dump_lidar(lidar) << "preset: \"" << lidar.preset << "\"\n";
  const auto n = [](double v) { return config::number_text(v); };
  text << "price_total_usd: {low: " << n(lidar.price_usd.low)
       << ", high: " << n(lidar.price_usd.high) << "}\n";
  text << "period_s: " << n(kFramePeriod) << "\n";
  text << "T_world_levelled: {x_m: " << n(mount.x_m) << ", y_m: " << n(mount.y_m)
       << ", z_m: " << n(mount.z_m) << ", yaw_deg: " << n(mount.yaw_deg) << "}\n";
  text << "T_levelled_sensor: {pitch_deg: " << n(mount.pitch_deg)
       << ", roll_deg: " << n(mount.roll_deg) << "}\n";
  text << "field_of_view:\n";
  const std::vector<FieldOfView> fields = fields_of_view(lidar);
  for (std::size_t i = 0; i < lidar.units.size(); ++i) {
    const LidarUnit& unit = lidar.units[i];
    const FieldOfView& fov = fields[i];
    const auto two = [&](double v) { return n(std::round(v * 100) / 100); };
    text << "  - {yaw_deg: " << n(unit.yaw_deg) << ", pitch_deg: " << n(unit.pitch_deg)
         << ", azimuth_deg: [" << two(fov.azimuth_min_deg) << ", " << two(fov.azimuth_max_deg)
         << "], elevation_deg: [" << two(fov.elevation_min_deg) << ", "
         << two(fov.elevation_max_deg) << "], range_m: [" << n(unit.returns.min_range_m) << ", "
         << n(unit.returns.max_range_m) << "]}\n";
  }
  return text.str();
}

/// Creates the folder, or checks that it holds the same run.
void open_folder(const RunRequest& request, const World& world) {
  std::vector<std::string> texts;  // first, as they may be refused
  for (const LidarConfig& lidar : request.lidars) texts.push_back(lidar_text(request, lidar));
  create_folder(request.out);
  claim_file(request.out / "dataset.yaml", run_text(request));
  claim_file(request.out / "trajectories.csv", trajectories_csv(world.trajectories));
  claim_file(request.out / "roads.csv", world.region.roads_csv());
  for (std::size_t i = 0; i < texts.size(); ++i) {
    const auto folder = request.out / request.lidars[i].name;
    create_frame_folders(folder, request.scene.point_fields);
    claim_file(folder / "lidar.yaml", texts[i]);
  }
}

/// Work shared by the threads of a run.
class Session {
 public:
  Session(const RunRequest& request, const World& world, const std::atomic<int>& stop,
          const Progress& progress)
      : request_(request), world_(world), stop_(stop), progress_(progress) {
    const FrameRange& f = request.frames;
    total_ = 1 + (f.last - 1 - f.first) / f.step;
    for (const LidarConfig& lidar : request.lidars) {
      SummaryRow row;
      row.lidar = lidar.name;
      row.preset = lidar.preset;
      rows_.push_back(row);
    }
  }

  void work() {
    try {
      FrameSimulator simulator(world_, request_.lidars);
      for (int i = next_++; i < total_ && stop_ == 0 && !failed_; i = next_++)
        frame(simulator, request_.frames.first + i * request_.frames.step);
    } catch (...) {
      const std::lock_guard lock(mutex_);
      if (!error_) error_ = std::current_exception();
      failed_ = true;
    }
  }

  std::vector<SummaryRow> finish(int threads) {
    if (error_) std::rethrow_exception(error_);
    for (SummaryRow& row : rows_) {
      const double frames = std::max(1, row.frames);
      row.hits_per_frame /= frames;
      row.vehicles_per_frame /= frames;
      row.vehicle_points_per_frame /= frames;
      row.rays_per_frame /= frames;
      row.seconds /= threads;
      row.mrays_per_s = row.seconds > 0 ? row.mrays_per_s / row.seconds : 0;
    }
    return rows_;
  }

 private:
  bool on_disk(const std::string& lidar, int k) const {
    return !request_.out.empty() && std::filesystem::exists(velodyne_file(request_.out / lidar, k));
  }

  void frame(FrameSimulator& simulator, int k) {
    std::vector<bool> wanted;
    for (const LidarConfig& lidar : request_.lidars) wanted.push_back(!on_disk(lidar.name, k));
    const std::vector<Frame> frames = simulator.simulate(k, wanted);
    std::vector<FrameCounts> counts;
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      const auto folder = request_.out / request_.lidars[i].name;
      if (wanted[i] && !request_.out.empty())
        write_frame(folder, k, frames[i], request_.scene.labels == LabelRule::kAll,
                    request_.scene.point_fields);
      counts.push_back(wanted[i] ? count(frames[i]) : read_counts(folder, k));
    }
    record(frames, counts);
  }

  void record(const std::vector<Frame>& frames, const std::vector<FrameCounts>& counts) {
    const std::lock_guard lock(mutex_);
    for (std::size_t i = 0; i < counts.size(); ++i) {
      SummaryRow& row = rows_[i];
      ++row.frames;
      row.hits_per_frame += static_cast<double>(counts[i].hits);
      row.vehicles_per_frame += static_cast<double>(counts[i].vehicles);
      row.vehicle_points_per_frame += static_cast<double>(counts[i].vehicle_points);
      row.rays_per_frame += static_cast<double>(frames[i].rays);
      row.seconds += frames[i].seconds;
      if (frames[i].seconds > 0) row.mrays_per_s += static_cast<double>(frames[i].rays) * 1e-6;
    }
    progress_(++done_, total_);
  }

  const RunRequest& request_;
  const World& world_;
  const std::atomic<int>& stop_;
  const Progress& progress_;
  int total_ = 0;
  std::atomic<int> next_ = 0;
  std::atomic<bool> failed_ = false;
  std::mutex mutex_;
  int done_ = 0;
  std::vector<SummaryRow> rows_;  ///< sums until finish()
  std::exception_ptr error_;
};

}  // namespace

std::vector<SummaryRow> run(const RunRequest& request, const std::atomic<int>& stop,
                            const Progress& progress) {
  check(request);
  const World world = build_world(request.scene);
  if (!request.out.empty()) open_folder(request, world);
  Session session(request, world, stop, progress);
  {
    std::vector<std::jthread> others;
    for (int i = 1; i < request.threads; ++i) others.emplace_back([&] { session.work(); });
    session.work();
  }
  std::vector<SummaryRow> rows = session.finish(request.threads);
  if (!request.out.empty() && stop == 0)
    replace_file(request.out / "summary.csv", summary_csv(rows));
  return rows;
}

std::string summary_csv(const std::vector<SummaryRow>& rows) {
  std::ostringstream text;
  text << "lidar,preset,frames,rays_per_frame,hits_per_frame,vehicles_per_frame,"
          "vehicle_points_per_frame,seconds,mrays_per_s\n";
  for (const SummaryRow& r : rows)
    text << r.lidar << ',' << r.preset << ',' << r.frames << ',' << r.rays_per_frame << ','
         << r.hits_per_frame << ',' << r.vehicles_per_frame << ',' << r.vehicle_points_per_frame
         << ',' << r.seconds << ',' << r.mrays_per_s << '\n';
  return text.str();
}

}  // namespace infrasim
