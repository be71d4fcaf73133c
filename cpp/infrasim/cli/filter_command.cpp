#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdio>
#include <memory>
#include <span>

#include "infrasim/cli/arguments.h"
#include "infrasim/cli/commands.h"
#include "infrasim/config/filter_declarations.h"
#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/filter/filter.h"
#include "infrasim/io/atomic_file.h"
#include "infrasim/io/cloud_file.h"

namespace infrasim::cli {

namespace {

// Sets a parameter of a filter to the first numbers of an option, and removes them from `numbers`.
void take(std::span<const double>& numbers, double& value) {
  value = numbers.front();
  numbers = numbers.subspan(1);
}

void take(std::span<const double>& numbers, std::array<double, 3>& values) {
  for (double& value : values) take(numbers, value);
}

void take(std::span<const double>& numbers, std::vector<Vec2>& outline) {
  if (numbers.size() % 2 != 0)
    throw ConfigError("--crop-polygon: expected an even number of values (x,y,x,y,...), got " +
                      std::to_string(numbers.size()) + " values");
  while (!numbers.empty()) {
    Vec2& corner = outline.emplace_back();
    take(numbers, corner.x);
    take(numbers, corner.y);
  }
}

/// Makes a filter. The numbers set the filter's parameters in the order of their declarations. A
/// parameter without a number keeps its default.
template <class Filter>
FilterStep filter_of(std::span<const double> numbers) {
  Filter filter;
  const auto set = [&](auto& value) {
    if (!numbers.empty()) take(numbers, value);
  };
  std::apply([&](const auto&... p) { (set(filter.*p.member), ...); },
             config::declaration(config::Of<Filter>{}).parameters);
  return filter;
}

struct FilterOption {
  const char* name;
  const char* help;
  int numbers;  ///< minimum number of values; an option with 0 values is a flag
  int most_numbers;
  FilterStep (*filter)(std::span<const double> numbers);
};

/// The filter options in the order of --help, which is also the order of the filter steps. Filters
/// that require the ground points come before filters that remove them.
constexpr std::array kFilterOptions{
    FilterOption{"--crop-box", "keep the points in a box: xmin,ymin,zmin,xmax,ymax,zmax (m)", 6, 6,
                 filter_of<CropBox>},
    FilterOption{"--crop-polygon", "keep the points in an outline: x,y,x,y,... (m)", 6, 10000,
                 filter_of<CropPolygon>},
    FilterOption{"--crop-range", "keep the points in a span of slant ranges: min,max (m)", 2, 2,
                 filter_of<CropRange>},
    FilterOption{"--fov",
                 "keep the points in a field of view: azimuth min,max,elevation min,max (deg)", 4,
                 4, filter_of<CropFieldOfView>},
    FilterOption{"--ground-morphological", "remove the points of roads, slopes and terrain", 0, 0,
                 filter_of<GroundMorphological>},
    FilterOption{
        "--ground-plane",
        "remove the points within this distance of the ground plane (m); an optional second "
        "number is the height of the sensor above the plane (m)",
        1, 2, filter_of<GroundPlane>},
    FilterOption{"--below-z", "remove the points at or below this height (m)", 1, 1,
                 filter_of<GroundHeight>},
};
static_assert(kFilterOptions.size() + 1 == std::variant_size_v<FilterStep>,
              "every filter except the learnt background has a row");

struct FilterOptions {
  std::string in;
  std::string out;
  std::string encoding;
  std::array<bool, kFilterOptions.size()> given{};
  std::array<std::vector<double>, kFilterOptions.size()> numbers;
  std::vector<std::string> background;
  std::string save_background;
};

/// Reads a saved background model, or learns a background model from frames of the sensor.
BackgroundModel background_of(const std::vector<std::string>& files) {
  if (files.size() == 1) {
    const std::string bytes = read_file(files.front());
    if (is_background(bytes)) return background_from_bytes(bytes, files.front());
  }
  std::vector<std::vector<float>> frames;
  for (const std::string& file : files) frames.push_back(read_cloud(file).xyz());
  return learn_background(frames);
}

std::vector<FilterStep> steps_of(const FilterOptions& o) {
  std::vector<FilterStep> steps;
  for (std::size_t i = 0; i < kFilterOptions.size(); ++i)
    if (o.given[i] || !o.numbers[i].empty())
      steps.push_back(kFilterOptions[i].filter(o.numbers[i]));
  if (!o.background.empty()) {
    steps.emplace_back(background_of(o.background));
    if (!o.save_background.empty()) {
      refuse_input("--save-background", o.save_background);
      write_file_atomically(o.save_background,
                            background_to_bytes(std::get<BackgroundModel>(steps.back())));
    }
  }
  return steps;
}

void warn_without_plane(const FilterStep& step, std::size_t before, std::size_t after) {
  if (!has_no_plane(step, before, after)) return;
  const double height_m = std::get<GroundPlane>(step).sensor_height_m;
  const std::string where =
      height_m > 0 ? " " + config::number_text(height_m) + " m below the sensor" : "";
  std::fprintf(stderr,
               "infrasim: warning: --ground-plane: found no plane%s, so all points are kept\n",
               where.c_str());
}

/// Warns if a .bin file seems to have another layout, and about information that a .bin file can't
/// contain.
void warn_of_bin(const FilterOptions& o, const CloudFile& cloud) {
  const auto warn = [&](const std::string& file, const std::string& text) {
    std::fprintf(stderr, "infrasim: warning: %s: %s\n", file.c_str(), text.c_str());
  };
  const std::vector<float> intensity = cloud.intensity();
  if (o.in.ends_with(".bin") && std::ranges::any_of(intensity, [](float v) { return v < 0; }))
    warn(o.in,
         "expected intensities of 0 or more, got negative values; check that a point has four "
         "float32 values");
  if (!o.out.ends_with(".bin")) return;
  if (intensity.empty()) warn(o.out, "the cloud has no intensity field: intensities are set to 0");
  if (const float most = cloud.intensity_max(); most != 1)
    warn(o.out, "intensities are divided by " + config::number_text(most) +
                    ", because those of a .bin are 0 to 1");
  const Viewpoint pose = cloud.pose();
  if (pose.is_identity()) return;
  const std::string shift = pose.is_far() ? "; its shift of 10 km or more is ignored" : "";
  warn(o.out, "points are moved by VIEWPOINT " + cloud.viewpoint +
                  ", but filters use the stored coordinates" + shift);
}

void filter_command(const FilterOptions& o) {
  CloudFile cloud = read_cloud(o.in);
  warn_of_bin(o, cloud);
  const std::vector<float> xyz = cloud.xyz();
  std::vector<int> kept;
  try {
    kept = keep_all(steps_of(o), xyz, warn_without_plane);
  } catch (const std::invalid_argument& e) {
    throw ConfigError(std::string("filter: ") + e.what());
  }
  CloudFile out = cloud.select(kept);
  if (o.encoding == "ascii") out.encoding = PcdEncoding::kAscii;
  if (o.encoding == "binary") out.encoding = PcdEncoding::kBinary;
  if (o.encoding == "binary_compressed") out.encoding = PcdEncoding::kBinaryCompressed;
  refuse_input("--out", o.out);
  write_cloud(o.out, out, cloud.intensity_max());
  std::printf("%zu points, %zu kept\n", cloud.points, kept.size());
}

}  // namespace

void add_filter_command(CLI::App& app) {
  auto* command = app.add_subcommand(
      "filter",
      "Crop a cloud, or remove its ground or background. Steps run in the order below. Points that "
      "are not finite, or 0 0 0, are no returns and are left out.\n"
      "Example: infrasim filter 000000.bin --out vehicles.pcd --crop-range 1,100 "
      "--ground-morphological");
  auto o = std::make_shared<FilterOptions>();
  command->add_option("in", o->in, "cloud: .bin (KITTI) or .pcd file")->required();
  command
      ->add_option("--out", o->out, "output: .bin or .pcd file; a .bin gets intensities of 0 to 1")
      ->required();
  for (std::size_t i = 0; i < kFilterOptions.size(); ++i) {
    const FilterOption& row = kFilterOptions[i];
    if (row.numbers == 0)
      command->add_flag(row.name, o->given[i], row.help);
    else
      command->add_option(row.name, o->numbers[i], row.help)
          ->delimiter(',')
          ->expected(row.numbers, row.most_numbers);
  }
  // Both ground filters require the ground points. If the first filter removed these points, the
  // second filter would remove roofs as ground.
  command->get_option("--ground-plane")->excludes(command->get_option("--ground-morphological"));
  auto* background =
      command->add_option("--background", o->background,
                          "remove the static background: a saved model, or frames of the sensor "
                          "from which it is learnt");
  command
      ->add_option("--save-background", o->save_background,
                   "file to which the learnt background model is written")
      ->needs(background);
  command
      ->add_option("--pcd", o->encoding,
                   "encoding of .pcd output: ascii, binary or binary_compressed; default: that of "
                   "the input, or binary")
      ->check(CLI::IsMember({"ascii", "binary", "binary_compressed"}));
  command->callback([o] { filter_command(*o); });
}

}  // namespace infrasim::cli
