#include "infrasim/pipeline/run_folder.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <string_view>

#include "infrasim/config/fields.h"
#include "infrasim/core/rng.h"
#include "infrasim/core/version.h"
#include "infrasim/io/data_set.h"
#include "infrasim/io/kitti.h"
#include "infrasim/sensor/pattern_table.h"

namespace infrasim {

namespace {

template <class T>
std::string digest(const std::vector<T>& values) {
  const std::string_view bytes(reinterpret_cast<const char*>(values.data()),
                               values.size() * sizeof(T));
  std::array<char, 17> text{};
  std::snprintf(text.data(), text.size(), "%016llx",
                static_cast<unsigned long long>(hash_name(bytes)));
  return text.data();
}

/// Of the surfaces that files brought: with others this is another data set.
std::string surfaces_text(const World& world) {
  if (!world.scene.meshes) return "";
  const TriangleMesh& mesh = world.background;
  return "surfaces: \"" + digest(mesh.vertices) + digest(mesh.triangles) + "\"\n";
}

std::string run_text(const RunRequest& request, const World& world) {
  SceneConfig scene = request.scene;
  scene.label_time = label_time_of(scene, request.preset);
  return dump_scene(scene) + surfaces_text(world) + "preset: \"" + request.preset +
         "\"\nversion: \"" + std::string(version()) + "\"\n";
}

/// Directions and ranges that a unit covers, as one entry of a YAML list.
std::string view_text(const LidarUnit& unit, const FieldOfView& view) {
  const auto n = [](double v) { return config::number_text(v); };
  const auto two = [&](double v) { return n(std::round(v * 100) / 100); };
  return "  - {yaw_deg: " + n(unit.yaw_deg) + ", pitch_deg: " + n(unit.pitch_deg) +
         ", azimuth_deg: [" + two(view.azimuth_min_deg) + ", " + two(view.azimuth_max_deg) +
         "], elevation_deg: [" + two(view.elevation_min_deg) + ", " + two(view.elevation_max_deg) +
         "], range_m: [" + n(unit.returns.min_range_m) + ", " + n(unit.returns.max_range_m) +
         "]}\n";
}

/// The LiDAR's configuration and what follows from it, for readers that know no scene.
std::string lidar_text(const World& world, const LidarConfig& lidar) {
  const SceneConfig& scene = world.scene;
  const MountConfig& mount = scene.mounts.begin()->second;
  const auto n = [](double v) { return config::number_text(v); };
  std::string text = dump_lidar(lidar) + "preset: \"" + lidar.preset + "\"\n";
  text += "price_total_usd: {low: " + n(lidar.price_usd.low) +
          ", high: " + n(lidar.price_usd.high) + "}\n";
  text += std::string("label_time: ") +
          enum_names(LabelTime{})[static_cast<std::size_t>(label_time_of(scene, lidar.preset))] +
          "\n";
  if (const auto layer = world.static_layers.find(lidar.name); layer != world.static_layers.end())
    text += "static_layer: \"" + layer->second.digest + "\"\n";
  text += "period_s: " + n(kFramePeriod) + "\n";
  text += "T_world_levelled: {x_m: " + n(mount.x_m) + ", y_m: " + n(mount.y_m) +
          ", z_m: " + n(mount.z_m) + ", yaw_deg: " + n(mount.yaw_deg) + "}\n";
  text += "T_levelled_sensor: {pitch_deg: " + n(mount.pitch_deg) +
          ", roll_deg: " + n(mount.roll_deg) + "}\n";
  text += "field_of_view:\n";
  const std::vector<FieldOfView> views = fields_of_view(lidar);
  for (std::size_t i = 0; i < views.size(); ++i) text += view_text(lidar.units[i], views[i]);
  return text;
}

}  // namespace

void open_run_folder(const RunRequest& request, const World& world) {
  std::vector<std::string> texts;  // first, as they may be refused
  for (const LidarConfig& lidar : request.lidars) texts.push_back(lidar_text(world, lidar));
  create_folder(request.out);
  claim_file(request.out / "dataset.yaml", run_text(request, world));
  claim_file(request.out / "trajectories.csv", trajectories_csv(world.trajectories));
  claim_file(request.out / "roads.csv", world.region.roads_csv());
  if (const std::string regions = world.region.regions_csv(); !regions.empty())
    claim_file(request.out / "regions.csv", regions);
  for (std::size_t i = 0; i < texts.size(); ++i) {
    const auto folder = request.out / request.lidars[i].name;
    create_frame_folders(folder, request.scene.point_fields);
    claim_file(folder / "lidar.yaml", texts[i]);
  }
}

}  // namespace infrasim
