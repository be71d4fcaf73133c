#include "infrasim/pipeline/run_folder.h"

#include <cmath>
#include <functional>

#include "infrasim/config/fields.h"
#include "infrasim/config/tree.h"
#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/core/numbers.h"
#include "infrasim/core/rng.h"
#include "infrasim/core/version.h"
#include "infrasim/io/data_set.h"
#include "infrasim/io/kitti.h"
#include "infrasim/io/npy.h"
#include "infrasim/pipeline/folder_identity.h"
#include "infrasim/pipeline/trajectory_file.h"
#include "infrasim/sensor/pattern_table.h"

namespace infrasim {

namespace {

/// Returns the line of dataset.yaml with a digest of the static surfaces, or an empty text if the
/// scene uses no mesh files.
std::string surfaces_text(const World& world) {
  if (!world.scene.meshes) return "";
  const TriangleMesh mesh = world.background();
  return "surfaces: \"" + hex_text(hash_all(mesh.vertices)) + hex_text(hash_all(mesh.triangles)) +
         "\"\n";
}

std::string run_text(const RunRequest& request, const World& world) {
  SceneConfig scene = request.scene;
  scene.label_time = label_time_of(scene, request.preset);
  return dump_scene(scene) + surfaces_text(world) + "preset: \"" + request.preset +
         "\"\nversion: \"" + std::string(version()) +
         "\"\nframes_version: " + std::to_string(kFramesVersion) + "\n";
}

/// Returns the field of view and range of a unit as one entry of a YAML list.
/// @param pose text with the pose of the unit's sensor; empty except for fused frames
std::string view_text(const LidarUnit& unit, const FieldOfView& view,
                      const std::string& pose = "") {
  const auto n = [](double v) { return config::number_text(v); };
  const auto two = [&](double v) { return n(std::round(v * 100) / 100); };
  return "  - {yaw_deg: " + n(unit.yaw_deg) + ", pitch_deg: " + n(unit.pitch_deg) +
         ", azimuth_deg: [" + two(view.azimuth_min_deg) + ", " + two(view.azimuth_max_deg) +
         "], elevation_deg: [" + two(view.elevation_min_deg) + ", " + two(view.elevation_max_deg) +
         "], range_m: [" + n(unit.returns.min_range_m) + ", " + n(unit.returns.max_range_m) + "]" +
         pose + "}\n";
}

/// Returns the lines of lidar.yaml with the preset and the price.
/// @param sensors number of copies of the LiDAR; the total price is this number times the LiDAR's
///   price
std::string price_text(const LidarConfig& lidar, std::size_t sensors) {
  const auto n = [&](double v) { return config::number_text(v * static_cast<double>(sensors)); };
  return "preset: \"" + lidar.preset + "\"\nprice_total_usd: {low: " + n(lidar.price_usd.low) +
         ", high: " + n(lidar.price_usd.high) + "}\n";
}

/// Returns the lines of lidar.yaml that depend on the scene, such as label time and transforms.
/// @param mount position, heading and tilt of the LiDAR
std::string frames_text(const World& world, const LidarConfig& lidar, const MountConfig& mount) {
  const SceneConfig& scene = world.scene;
  const auto n = [](double v) { return config::number_text(v); };
  std::string text =
      std::string("label_time: ") +
      enum_names(LabelTime{})[static_cast<std::size_t>(label_time_of(scene, lidar.preset))] + "\n";
  if (const auto layer = world.static_layers.find(lidar.name); layer != world.static_layers.end())
    text += "static_layer: \"" + layer->second.digest + "\"\n";
  text += "period_s: " + n(period_s(lidar)) + "\n";
  text += "T_world_levelled: {x_m: " + n(mount.x_m) + ", y_m: " + n(mount.y_m) +
          ", z_m: " + n(mount.z_m) + ", yaw_deg: " + n(mount.yaw_deg) + "}\n";
  text += "T_levelled_sensor: {pitch_deg: " + n(mount.pitch_deg) +
          ", roll_deg: " + n(mount.roll_deg) + "}\n";
  return text + "field_of_view:\n";
}

/// Returns the pose of a mount's sensor in the fused frame, as YAML text.
std::string pose_text(const MountConfig& mount) {
  const auto n = [](double v) { return config::number_text(std::round(v * 1e4) / 1e4 + 0.0); };
  return ", at: {x_m: " + n(mount.x_m) + ", y_m: " + n(mount.y_m) + ", z_m: " + n(mount.z_m) +
         ", yaw_deg: " + n(mount.yaw_deg) + ", pitch_deg: " + n(mount.pitch_deg) +
         ", roll_deg: " + n(mount.roll_deg) + "}";
}

/// Returns the first lines of lidar.yaml: name and model.
std::string lidar_text(const LidarConfig& lidar) {
  const std::string text = dump_lidar(lidar);
  return text.substr(0, text.find('\n', text.find('\n') + 1) + 1);
}

/// Returns the line of a fused lidar.yaml with the names of the mounts.
/// @param written function that returns a name as it is written in the file
std::string mounts_line(const NamedMap<MountConfig>& mounts,
                        const std::function<std::string(const std::string&)>& written) {
  std::vector<std::string> names;
  for (const auto& [name, mount] : mounts) names.push_back(written(name));
  return "mounts: [" + listed(names) + "]\n";
}

/// Returns the line of a fused lidar.yaml with a digest of the LiDAR's configuration.
std::string digest_line(LidarConfig lidar) {
  for (LidarUnit& unit : lidar.units)  // the configuration contains digests of the firing tables
    if (unit.pattern.table) unit.pattern.table->file.clear();
  return "lidar_digest: \"" + hex_text(hash_name(canonical_lidar(lidar))) + "\"\n";
}

/// Returns the text of lidar.yaml for the fused frames of all mounts. It has no pattern, because no
/// single LiDAR could have cast the fused rays.
std::string fused_text(const RunRequest& request, const World& first, const Fusion& fusion,
                       const LidarConfig& lidar) {
  const auto& mounts = request.scene.mounts;
  MountConfig level = mounts.begin()->second;
  level.pitch_deg = level.roll_deg = 0;
  std::string text = lidar_text(lidar) + mounts_line(mounts, config::quoted_name) +
                     price_text(lidar, mounts.size()) + frames_text(first, lidar, level);
  const std::vector<FieldOfView> views = fields_of_view(lidar);
  for (std::size_t m = 0; m < mounts.size(); ++m)
    for (std::size_t i = 0; i < views.size(); ++i)
      text += view_text(lidar.units[i], views[i], pose_text(fusion.seen_from_first(m)));
  return text + digest_line(lidar);
}

/// Returns the identity of a fused lidar.yaml. Earlier versions wrote no digest, and wrote the
/// names of mounts without quotes. The identity of such a file contains the lines that this run
/// would write.
Identity fused_identity(const RunRequest& request, const LidarConfig& lidar) {
  const auto& mounts = request.scene.mounts;
  const std::string before = mounts_line(mounts, [](const std::string& name) { return name; });
  return [before, now = mounts_line(mounts, config::quoted_name), digest = digest_line(lidar)](
             std::string text, const std::string&) {
    if (const auto at = text.find("\n" + before); at != std::string::npos)
      text.replace(at + 1, before.size(), now);
    return text.find("\nlidar_digest: ") == std::string::npos ? text + digest : text;
  };
}

/// Returns a copy of the LiDAR whose firing tables lie in the folder of lidar.yaml, so that the
/// data set is complete.
LidarConfig with_tables_beside(LidarConfig lidar) {
  for (std::size_t i = 0; i < lidar.units.size(); ++i)
    if (auto& table = lidar.units[i].pattern.table)
      table->file = i == 0 ? "table.npy" : "table_" + std::to_string(i) + ".npy";
  return lidar;
}

/// Writes the firing tables that are not in the folder yet. Their digests are in lidar.yaml.
void write_tables(const LidarConfig& lidar, const std::filesystem::path& folder) {
  for (const LidarUnit& unit : lidar.units) {
    if (!unit.pattern.table) continue;
    const TableConfig& table = *unit.pattern.table;
    if (std::filesystem::exists(folder / table.file)) continue;
    std::vector<double> values;
    for (std::size_t i = 0; i < table.directions.size(); ++i) {
      values.insert(values.end(), {table.directions[i].x, table.directions[i].y});
      if (!table.times_s.empty()) values.push_back(table.times_s[i]);
    }
    write_npy(folder / table.file, values, table.times_s.empty() ? 2 : 3);
  }
}

/// Checks that the LiDARs of a folder have the frame period of the run. A damaged lidar.yaml is
/// skipped here, and reported by a run of the LiDAR to which it belongs.
/// @throws IoError
void check_same_period(const std::filesystem::path& folder, double period_s) {
  std::error_code error, ignored;
  const std::vector<std::filesystem::path> entries = entries_of(folder, error);
  if (error) throw IoError(folder.string() + ": can't be read: " + error.message());
  for (const std::filesystem::path& entry : entries) {
    const auto file = entry / "lidar.yaml";
    // also skips an entry that can't be read
    if (!std::filesystem::exists(file, ignored)) continue;
    config::Tree tree;
    try {
      tree = config::read_tree(file);
    } catch (const ConfigError&) {
      continue;
    }
    const config::Tree* there = tree.find("period_s");
    if (there != nullptr && there->scalar != config::number_text(period_s))
      throw IoError(file.string() + ": period_s: expected one period in a folder, got " +
                    there->scalar + " s there and " + config::number_text(period_s) +
                    " s in this run");
  }
}

/// Creates the folder of a run and its files, or checks that existing files belong to the same run.
/// @param texts      texts of lidar.yaml, one per LiDAR of the request
/// @param identities identities of these texts
void claim_folder(const RunRequest& request, const World& world,
                  const std::vector<std::string>& texts, const std::vector<Identity>& identities) {
  create_folder(request.out);
  check_frames_version(request.out / "dataset.yaml");
  claim_file(request.out / "dataset.yaml", run_text(request, world), data_set_identity);
  check_same_period(request.out, period_s(request.lidars));
  claim_file(request.out / "roads.csv", world.region.roads_csv());
  if (const std::string regions = world.region.regions_csv(); !regions.empty())
    claim_file(request.out / "regions.csv", regions);
  for (std::size_t i = 0; i < texts.size(); ++i) {
    const auto folder = request.out / request.lidars[i].name;
    create_frame_folders(folder, request.scene.point_fields);
    claim_file(folder / "lidar.yaml", texts[i], identities[i]);
  }
  // The trajectories are merged last, because this step changes a file of an existing folder.
  const std::vector<int> frames = frame_numbers(request.frames);
  merge_trajectories(request.out / "trajectories.csv", world,
                     rows_of_run(request.scene, frames, period_s(request.lidars)));
}

}  // namespace

std::string lidar_yaml(const World& world, const LidarConfig& lidar) {
  std::string text = dump_lidar(lidar) + price_text(lidar, 1) +
                     frames_text(world, lidar, world.scene.mounts.begin()->second);
  const std::vector<FieldOfView> views = fields_of_view(lidar);
  for (std::size_t i = 0; i < views.size(); ++i) text += view_text(lidar.units[i], views[i]);
  return text;
}

void open_run_folder(const RunRequest& request, const World& world) {
  std::vector<LidarConfig> lidars;
  std::vector<std::string> texts;  // built before the folder is changed, because building may fail
  for (const LidarConfig& lidar : request.lidars)
    texts.push_back(lidar_yaml(world, lidars.emplace_back(with_tables_beside(lidar))));
  claim_folder(request, world, texts, std::vector<Identity>(texts.size(), lidar_identity));
  for (const LidarConfig& lidar : lidars) write_tables(lidar, request.out / lidar.name);
}

void open_fused_folder(const RunRequest& request, const World& first, const Fusion& fusion) {
  std::vector<std::string> texts;
  std::vector<Identity> identities;
  for (const LidarConfig& lidar : request.lidars) {
    texts.push_back(fused_text(request, first, fusion, lidar));
    identities.push_back(fused_identity(request, lidar));
  }
  claim_folder(request, first, texts, identities);
  if (!request.scene.point_fields) return;
  for (const LidarConfig& lidar : request.lidars)
    create_folder(request.out / lidar.name / "training" / "mounts");
}

}  // namespace infrasim
