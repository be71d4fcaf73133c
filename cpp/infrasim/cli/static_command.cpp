#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "infrasim/cli/arguments.h"
#include "infrasim/cli/catalogue.h"
#include "infrasim/cli/commands.h"
#include "infrasim/config/fields.h"
#include "infrasim/config/lidar_config.h"
#include "infrasim/config/scene_config.h"
#include "infrasim/io/atomic_file.h"
#include "infrasim/pipeline/static_layer_file.h"
#include "infrasim/pipeline/static_recording.h"
#include "infrasim/pipeline/static_units.h"

namespace infrasim::cli {

namespace {

struct StaticOptions {
  std::string scene;
  std::string lidar;
  std::string preset = "datasheet";
  std::optional<double> rate_hz;
  std::optional<std::string> recording;
  std::string out;
  std::vector<std::string> assignments;
};

std::vector<StaticHits> recorded_units(const SceneConfig& scene, const LidarConfig& lidar,
                                       const StaticOptions& o) {
  RecordedLayer layer = recorded_static_layer(scene, lidar, *o.recording);
  std::printf("%d frames, largest difference of elevations %.3f degrees\n", layer.frames,
              layer.elevation_miss_deg);
  const MountConfig& mount = scene.mounts.begin()->second;
  const auto n = [](double v) { return config::number_text(v); };
  const std::string pose = "x_m " + n(mount.x_m) + ", y_m " + n(mount.y_m) + ", z_m " +
                           n(mount.z_m) + ", yaw_deg " + n(mount.yaw_deg) + ", pitch_deg " +
                           n(mount.pitch_deg) + ", roll_deg " + n(mount.roll_deg);
  std::printf(
      "assumes that the pose of the sensor is that of the mount (%s); only pitch and roll are "
      "checked, from the elevations\n",
      pose.c_str());
  for (std::size_t i = 0; i < layer.azimuth_offsets_deg.size(); ++i)
    std::printf("unit %zu: columns %+.4f degrees from those of the LiDAR's file\n", i,
                layer.azimuth_offsets_deg[i]);
  if (layer.too_far > 0)
    std::fprintf(stderr, "infrasim: warning: %s: removed %zu returns beyond the LiDAR's range\n",
                 o.recording->c_str(), layer.too_far);
  return std::move(layer.units);
}

void static_command(const StaticOptions& o) {
  SceneConfig scene = read_scene(config_file(o.scene, {"scenes"}), o.assignments, o.preset);
  scene.static_layers.reset();  // existing layers are ignored, because this command makes them
  const LidarConfig lidar = lidar_of(o.lidar, o.preset, {o.rate_hz, {}, {}});
  const World world = build_static_world(scene);
  const std::vector<StaticHits> units =
      o.recording ? recorded_units(scene, lidar, o) : cast_static_layer(world, lidar);
  LayerOrigin origin = layer_origin(world.scene, world.background());
  if (o.recording) origin.scene = 0;
  refuse_input("--out", o.out);
  write_file_atomically(o.out, static_layer_to_bytes(origin, units));
  std::size_t rays = 0, hits = 0;
  for (const StaticHits& unit : units) {
    rays += unit.rays();
    hits += static_cast<std::size_t>(
        std::ranges::count_if(unit.range_m, [](float range) { return std::isfinite(range); }));
  }
  std::printf("%zu rays, %zu hit\n", rays, hits);
}

}  // namespace

void add_static_command(CLI::App& app) {
  auto* command = app.add_subcommand(
      "static",
      "Write the static points of a LiDAR whose scan pattern repeats, for the key static_layers of "
      "a scene.\nExample: infrasim static highway --lidar ruby_plus --out ruby_plus.layer");
  auto o = std::make_shared<StaticOptions>();
  command->add_option("scene", o->scene, "scene: a file or a name")->required();
  command->add_option("--lidar", o->lidar, "LiDAR: a file or a name")->required();
  command->add_option("--preset", o->preset, "preset of the LiDAR and of the scene")
      ->capture_default_str();
  command->add_option("--rate-hz", o->rate_hz, kRateHelp);
  command->add_option(
      "--recording", o->recording,
      "recording of the empty site (DATA/LIDAR), whose points replace those of the scene");
  command->add_option("--out", o->out, "output: file of static points")->required();
  command->add_option("--set", o->assignments, "KEY=VALUE: overrides a key of the scene");
  command->callback([o] { static_command(*o); });
}

}  // namespace infrasim::cli
