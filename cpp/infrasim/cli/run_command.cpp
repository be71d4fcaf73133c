#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>
#include <optional>
#include <ranges>
#include <thread>
#include <utility>

#include "infrasim/cli/arguments.h"
#include "infrasim/cli/catalogue.h"
#include "infrasim/cli/commands.h"
#include "infrasim/cli/signals.h"
#include "infrasim/config/fields.h"
#include "infrasim/config/lidar_checks.h"
#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/io/atomic_file.h"
#include "infrasim/pipeline/run.h"
#include "infrasim/pipeline/scheduler.h"
#include "infrasim/scene/trajectories.h"
#include "infrasim/sensor/return_model.h"

namespace infrasim::cli {

namespace {

struct RunOptions {
  std::string scene;
  std::vector<std::string> lidars;
  std::string preset = "datasheet";
  LidarChanges changes;
  std::string frames = "0:100";
  std::optional<std::string> out, summary, aggregation, detail, labels, label_time, seed;
  std::vector<std::string> assignments;
  std::vector<std::string> mounts;
  bool fuse = false;
  bool fields = false;
  bool cast_all = false;
  int threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
};

/// Returns the assignments of --set, and of options that override a scene key of the same name.
std::vector<std::string> assignments(const RunOptions& o) {
  std::vector<std::string> all = o.assignments;
  const auto add = [&](const char* key, const std::optional<std::string>& value) {
    if (value) all.push_back(std::string(key) + "=" + *value);
  };
  add("aggregation", o.aggregation);
  add("detail", o.detail);
  add("labels", o.labels);
  add("label_time", o.label_time);
  add("seed", o.seed);
  if (o.fields) add("fields", "true");
  return all;
}

/// Returns the path of an option; empty if the option is missing. An empty argument is an error.
std::string path_of(const char* option, const std::optional<std::string>& value) {
  if (value && value->empty())
    throw ConfigError(std::string(option) + ": expected a file or folder, got an empty path");
  return value.value_or("");
}

/// Keeps only the named mounts of a scene, in the scene's order.
/// @throws ConfigError if a name is unknown or given twice
void keep_mounts(SceneConfig& scene, std::vector<std::string> names) {
  NamedMap<MountConfig> kept;
  for (const auto& [name, mount] : scene.mounts) {
    const auto position = std::ranges::find(names, name);
    if (position == names.end()) continue;
    names.erase(position);
    kept[name] = mount;
  }
  if (!names.empty())
    throw ConfigError("--mount: expected one or more of " + listed(std::views::keys(scene.mounts)) +
                      ", each at most once, got '" + names.front() + "'");
  scene.mounts = std::move(kept);
}

RunRequest request_of(const RunOptions& o) {
  RunRequest request;
  request.scene = read_scene(config_file(o.scene, {"scenes"}), assignments(o), o.preset);
  for (const std::string& word : o.lidars)
    request.lidars.push_back(lidar_of(word, o.preset, o.changes));
  request.preset = o.preset;
  const double duration_s = request.scene.duration_s;
  request.frames = parse_frames(o.frames, frame_count(duration_s, period_s(request.lidars)),
                                "duration_s is " + config::number_text(duration_s) + " s");
  request.out = path_of("--out", o.out);
  if (o.mounts.size() == 1) request.mount = o.mounts.front();
  if (o.mounts.size() > 1) keep_mounts(request.scene, o.mounts);
  request.fuse = o.fuse;
  request.threads = o.threads;
  request.cast_all = o.cast_all;
  return request;
}

/// Returns a progress bar for a terminal, which is updated at most ten times a second. Nothing is
/// shown if the output is not a terminal. After the first frame, SIGINT and SIGTERM let running
/// frames finish.
Progress progress_bar() {
  if (::isatty(STDERR_FILENO) == 0) return [](int, int) { finish_before_signals(); };
  using Clock = std::chrono::steady_clock;
  return [start = Clock::now(), last = Clock::time_point{}](int done, int total) mutable {
    finish_before_signals();
    const auto now = Clock::now();
    if (done < total && now - last < std::chrono::milliseconds(100)) return;
    last = now;
    constexpr int kWidth = 30;
    const double rate = done / std::chrono::duration<double>(now - start).count();
    const std::string bar(static_cast<std::size_t>(kWidth * done / total), '=');
    std::fprintf(stderr, "\r[%-*s] %d/%d frames, %.1f frames/s, %.0f s left ", kWidth, bar.c_str(),
                 done, total, rate, (total - done) / rate);
    if (done == total) std::fputc('\n', stderr);
  };
}

void print_table(const std::vector<SummaryRow>& rows) {
  std::printf("%-22s %-9s %6s %10s %10s %9s %15s %8s %8s\n", "lidar", "preset", "frames",
              "rays/frame", "hits/frame", "vehicles", "vehicle points", "seconds", "Mrays/s");
  for (const SummaryRow& r : rows)
    std::printf("%-22s %-9s %6d %10.0f %10.1f %9.1f %15.1f %8.2f %8.1f\n", r.lidar.c_str(),
                r.preset.c_str(), r.frames, r.rays_per_frame, r.hits_per_frame,
                r.vehicles_per_frame, r.vehicle_points_per_frame, r.seconds, r.mrays_per_s);
}

void warn(const std::string& line) {
  std::fprintf(stderr, "infrasim: warning: %s\n", line.c_str());
}

int run_command(const RunOptions& o) {
  const RunRequest request = request_of(o);
  const std::string summary = path_of("--summary", o.summary);
  expect_regular(summary);
  refuse_input("--summary", summary);
  for (const std::string& line : weather_warnings(request.scene.weather, request.lidars))
    warn(line);
  for (const std::string& line : lidar_warnings(request.lidars)) warn(line);
  const std::vector<SummaryRow> rows = run(request, noted_signal(), progress_bar(), warn);
  print_table(rows);
  refuse_input("--summary", summary);
  if (!summary.empty()) write_file_atomically(summary, summary_csv(rows));
  const int signal = noted_signal();
  if (signal == 0) {
    if (o.out && ::isatty(STDOUT_FILENO) != 0)
      std::printf("next: pyinfra view %s --out %s/view.html\n", o.out->c_str(), o.out->c_str());
    return 0;
  }
  say_stopped(signal);
  return 128 + signal;
}

}  // namespace

void add_run_command(CLI::App& app, CommandResult& result) {
  auto* command = app.add_subcommand(
      "run",
      "Simulate frames of one scene for several LiDARs.\nExample: infrasim run highway "
      "--lidar ruby_plus livox_avia --preset paper --frames 0:100 --out data/highway");
  auto o = std::make_shared<RunOptions>();
  command->add_option("scene", o->scene, "scene: a file or a name, such as highway")->required();
  command->add_option("--lidar", o->lidars, "LiDARs: files or names, such as livox_avia")
      ->required();
  command
      ->add_option("--preset", o->preset,
                   "preset of the LiDARs, and of the scene if the scene has it")
      ->capture_default_str();
  command->add_option("--rate-hz", o->changes.rate_hz, kRateHelp);
  command->add_option("--frames", o->frames, "frame numbers from A to B without B: A:B[:STEP]")
      ->capture_default_str();
  command->add_option("--out", o->out, "folder of the data set; default: nothing is written");
  command->add_option("--summary", o->summary, "CSV file to which the summary is also written");
  command->add_option("--threads", o->threads, "number of frames computed at the same time")
      ->capture_default_str()
      ->check(CLI::Range(1, kMostThreads));
  command
      ->add_option("--mount", o->mounts,
                   "mounts to simulate, if the scene has several: A,B; default: all")
      ->delimiter(',')
      ->allow_extra_args(false);
  command->add_flag("--fuse", o->fuse,
                    "also merge the frames of all mounts and write them to OUT/fused");
  command->add_option("--seed", o->seed, "seed; default: the seed of the scene");
  command->add_option("--aggregation", o->aggregation,
                      "aggregation: exact, instant or slices:N; default: that of the scene");
  command->add_option(
      "--detail", o->detail,
      "level of detail of the vehicles: box, low, mid or fine; default: that of the scene");
  command->add_option("--labels", o->labels,
                      "objects that get a label: hit or all; default: that of the scene");
  command->add_option(
      "--label-time", o->label_time,
      "time of the labels: frame (its middle) or scan; default: that of the scene and "
      "preset");
  command->add_flag("--fields", o->fields, "write time, ring, class and object of every point");
  command->add_flag("--cast-all", o->cast_all,
                    "cast the static scene in every frame too; slower, with the same frames");
  command->add_option("--set", o->assignments, "KEY=VALUE: overrides a key of the scene");
  command->add_option("--law-exponent", o->changes.law_exponent, kLawExponentHelp);
  command->add_option("--echo", o->changes.echo, kEchoHelp);
  command->callback([o, &result] { result.exit_code = run_command(*o); });
}

}  // namespace infrasim::cli
