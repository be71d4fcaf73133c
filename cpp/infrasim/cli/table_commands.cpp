// The commands that write a LiDAR's rays and a scene's trajectories as tables.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <optional>

#include "infrasim/cli/arguments.h"
#include "infrasim/cli/catalogue.h"
#include "infrasim/cli/commands.h"
#include "infrasim/config/lidar_config.h"
#include "infrasim/config/scene_config.h"
#include "infrasim/core/files.h"
#include "infrasim/io/atomic_file.h"
#include "infrasim/io/npy.h"
#include "infrasim/pipeline/world.h"
#include "infrasim/scene/site_rules.h"
#include "infrasim/scene/state_source.h"
#include "infrasim/scene/trajectory_text.h"
#include "infrasim/sensor/pattern_table.h"

namespace infrasim::cli {

namespace {

struct PatternOptions {
  std::string file;
  std::string preset = "datasheet";
  std::optional<double> rate_hz;
  std::string frames = "0:1";
  std::string out;
  std::string mount = kUsualMount;
  std::optional<std::string> seed;
};

void pattern_command(const PatternOptions& o) {
  const LidarConfig lidar = lidar_of(o.file, o.preset, {o.rate_hz, {}, {}});
  const FrameRange frames = parse_frames(o.frames, frame_count(kLongestScene_s, period_s(lidar)));
  const auto seed = o.seed ? std::optional(parse_seed(*o.seed)) : std::nullopt;
  const std::vector<double> rows =
      pattern_table(lidar, frames.first, frames.last, frames.step, seed, o.mount);
  refuse_input("--out", o.out);
  write_npy(o.out, rows, 3);
  std::printf("%zu rays\n", rows.size() / 3);
}

struct TrajectoriesOptions {
  std::string scene;
  std::string preset = "datasheet";
  std::string out;
  std::vector<std::string> assignments;
};

void trajectories_command(const TrajectoriesOptions& o) {
  const SceneConfig scene = read_scene(config_file(o.scene, {"scenes"}), o.assignments, o.preset);
  const std::filesystem::path file = o.out;
  remove_leftovers(file.parent_path().empty() ? "." : file.parent_path());
  AtomicFile out(file);
  const Site site = checked_site(scene);
  const StateSource state_source(site);
  const RowSource rows = [&](const RowSink& sink) {
    state_source.each([&, row = 0](const auto& states) mutable { sink(row++, states); });
  };
  write_trajectories(state_source.pitched(), rows, [&](std::string_view text) { out.write(text); });
  refuse_input("--out", file);
  out.replace();
  std::printf("%d frames\n", row_steps(scene.duration_s));
}

}  // namespace

void add_pattern_command(CLI::App& app) {
  auto* command = app.add_subcommand(
      "pattern",
      "Write azimuth, elevation (rad) and time (s) of every ray as .npy (n, 3).\n"
      "Example: infrasim pattern configs/lidars/livox_avia.yaml --frames 0:40 --out "
      "avia.npy");
  auto o = std::make_shared<PatternOptions>();
  command->add_option("lidar", o->file, "LiDAR: a file or a name")->required();
  command->add_option("--preset", o->preset, "preset of the LiDAR")->capture_default_str();
  command->add_option("--rate-hz", o->rate_hz, kRateHelp);
  command->add_option("--frames", o->frames, "frame numbers from A to B without B: A:B[:STEP]")
      ->capture_default_str();
  command->add_option("--out", o->out, "output: .npy file")->required();
  command->add_option("--seed", o->seed,
                      "seed of the start angles of free motors; default: all motors are locked");
  command->add_option("--mount", o->mount, "mount of the LiDAR, which affects the start angles")
      ->capture_default_str();
  command->callback([o] { pattern_command(*o); });
}

void add_trajectories_command(CLI::App& app) {
  auto* command =
      app.add_subcommand("trajectories",
                         "Write the objects of a scene as .csv, with 10 rows per second.\nExample: "
                         "infrasim trajectories configs/scenes/curve.yaml --out curve.csv");
  auto o = std::make_shared<TrajectoriesOptions>();
  command->add_option("scene", o->scene, "scene: a file or a name")->required();
  command->add_option("--out", o->out, "output: .csv file")->required();
  command->add_option("--preset", o->preset, "preset of the scene")->capture_default_str();
  command->add_option("--set", o->assignments, "KEY=VALUE: overrides a key of the scene");
  command->callback([o] { trajectories_command(*o); });
}

}  // namespace infrasim::cli
