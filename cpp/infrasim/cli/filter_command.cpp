#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <optional>

#include "infrasim/cli/commands.h"
#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/filter/filter.h"
#include "infrasim/io/atomic_file.h"
#include "infrasim/io/cloud_file.h"

namespace infrasim::cli {

namespace {

struct FilterOptions {
  std::string in;
  std::string out;
  std::string encoding;
  std::vector<double> crop_box, crop_polygon, range, field_of_view;
  std::vector<std::string> background;
  std::string save_background;
  std::optional<double> below_z, ground_plane;
  bool ground_morphological = false;
};

/// A saved model, or one learnt from frames of the sensor.
BackgroundModel background_of(const std::vector<std::string>& files) {
  if (files.size() == 1) {
    const std::string bytes = read_file(files.front());
    if (is_background(bytes)) return background_from_bytes(bytes, files.front());
  }
  std::vector<std::vector<float>> frames;
  for (const std::string& file : files) frames.push_back(read_cloud(file).xyz());
  return learn_background(frames);
}

/// In the order of --help: what needs the ground before what removes it.
std::vector<FilterStep> steps_of(const FilterOptions& o) {
  std::vector<FilterStep> steps;
  if (const auto& b = o.crop_box; !b.empty())
    steps.emplace_back(CropBox{{b[0], b[1], b[2]}, {b[3], b[4], b[5]}});
  if (const auto& p = o.crop_polygon; !p.empty()) {
    if (p.size() % 2 != 0)
      throw ConfigError("--crop-polygon: found " + std::to_string(p.size()) +
                        " numbers, allowed an even count: x,y,x,y,...");
    CropPolygon polygon;
    for (std::size_t i = 0; i + 1 < p.size(); i += 2) polygon.outline_m.push_back({p[i], p[i + 1]});
    steps.emplace_back(polygon);
  }
  if (!o.range.empty()) steps.emplace_back(CropRange{o.range[0], o.range[1]});
  if (const auto& f = o.field_of_view; !f.empty())
    steps.emplace_back(CropFieldOfView{f[0], f[1], f[2], f[3]});
  if (o.ground_morphological) steps.emplace_back(GroundMorphological{});
  if (o.ground_plane) steps.emplace_back(GroundPlane{.distance_m = *o.ground_plane});
  if (o.below_z) steps.emplace_back(GroundHeight{*o.below_z});
  if (!o.background.empty()) {
    steps.emplace_back(background_of(o.background));
    if (!o.save_background.empty())
      write_file_atomically(o.save_background,
                            background_to_bytes(std::get<BackgroundModel>(steps.back())));
  }
  return steps;
}

void filter_command(const FilterOptions& o) {
  CloudFile cloud = read_cloud(o.in);
  const std::vector<float> xyz = cloud.xyz();
  std::vector<int> kept;
  try {
    kept = keep_all(steps_of(o), xyz);
  } catch (const std::invalid_argument& e) {
    throw ConfigError(std::string("filter: ") + e.what());
  }
  CloudFile out = cloud.select(kept);
  if (o.encoding == "ascii") out.encoding = PcdEncoding::kAscii;
  if (o.encoding == "binary") out.encoding = PcdEncoding::kBinary;
  if (o.encoding == "binary_compressed") out.encoding = PcdEncoding::kBinaryCompressed;
  write_cloud(o.out, out);
  std::printf("%zu points, %zu kept\n", cloud.points, kept.size());
}

}  // namespace

void add_filter_command(CLI::App& app) {
  auto* command = app.add_subcommand(
      "filter",
      "Crop a cloud, remove its ground or its background; steps run in this order.\n"
      "Example: infrasim filter 000000.bin --out vehicles.pcd --range 1,100 "
      "--ground-morphological");
  auto o = std::make_shared<FilterOptions>();
  command->add_option("in", o->in, ".bin (KITTI) or .pcd file")->required();
  command->add_option("--out", o->out, ".bin or .pcd file")->required();
  command->add_option("--crop-box", o->crop_box, "xmin,ymin,zmin,xmax,ymax,zmax (m)")
      ->delimiter(',')
      ->expected(6);
  command->add_option("--crop-polygon", o->crop_polygon, "x,y,x,y,... of an outline (m)")
      ->delimiter(',')
      ->expected(6, 10000);
  command->add_option("--range", o->range, "min,max (m)")->delimiter(',')->expected(2);
  command->add_option("--fov", o->field_of_view, "azimuth min,max,elevation min,max (deg)")
      ->delimiter(',')
      ->expected(4);
  auto* opening = command->add_flag("--ground-morphological", o->ground_morphological,
                                    "remove roads, slopes and terrain");
  // Each needs the ground: after one, the other would take roofs for it.
  command->add_option("--ground-plane", o->ground_plane, "remove what is this close to a plane (m)")
      ->excludes(opening);
  command->add_option("--below-z", o->below_z, "remove what is not above this height (m)");
  auto* background = command->add_option("--background", o->background,
                                         "a saved model, or frames of the sensor to learn from");
  command->add_option("--save-background", o->save_background, "write the learnt model")
      ->needs(background);
  command->add_option("--pcd", o->encoding, "ascii, binary or binary_compressed")
      ->check(CLI::IsMember({"ascii", "binary", "binary_compressed"}));
  command->callback([o] { filter_command(*o); });
}

}  // namespace infrasim::cli
