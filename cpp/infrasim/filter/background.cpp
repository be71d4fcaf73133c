#include "infrasim/filter/background.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>

#include "infrasim/filter/points.h"

namespace infrasim {

namespace {

constexpr float kUnseen = std::numeric_limits<float>::infinity();

struct Sample {
  float range;
  float z;
};

int cell_of(const BackgroundModel& model, Vec3 p) {
  const double turn = std::atan2(p.y, p.x) / (2 * kPi) + 0.5;
  const double tilt = std::atan2(p.z, std::hypot(p.x, p.y)) / kPi + 0.5;
  const int a = std::min(static_cast<int>(turn * model.azimuth_cells), model.azimuth_cells - 1);
  const int e = std::min(static_cast<int>(tilt * model.elevation_cells), model.elevation_cells - 1);
  return e * model.azimuth_cells + a;
}

/// Samples of all frames, ordered by cell; those of cell c lie in [begin[c], begin[c + 1]).
struct CellSamples {
  std::vector<std::size_t> begin;
  std::vector<Sample> samples;
};

template <class Use>
void for_each_point(std::span<const std::vector<float>> frames, Use use) {
  for (const std::vector<float>& xyz : frames)
    for (std::size_t i = 0; i < point_count(xyz); ++i)
      if (const Vec3 p = point_at(xyz, i); is_finite(p)) use(p);
}

CellSamples sort_by_cell(std::span<const std::vector<float>> frames, const BackgroundModel& model) {
  CellSamples cells;
  cells.begin.assign(model.range_m.size() + 1, 0);
  for_each_point(frames, [&](Vec3 p) { ++cells.begin[cell_of(model, p) + 1]; });
  std::partial_sum(cells.begin.begin(), cells.begin.end(), cells.begin.begin());
  cells.samples.resize(cells.begin.back());
  std::vector<std::size_t> next = cells.begin;
  for_each_point(frames, [&](Vec3 p) {
    cells.samples[next[cell_of(model, p)]++] = {static_cast<float>(norm(p)),
                                                static_cast<float>(p.z)};
  });
  return cells;
}

/// The value that a share of the samples lies below.
float quantile(std::span<Sample> samples, double share, float Sample::* value) {
  const auto k = static_cast<std::size_t>(share * static_cast<double>(samples.size() - 1) + 0.5);
  std::ranges::nth_element(samples, samples.begin() + static_cast<std::ptrdiff_t>(k), {}, value);
  return samples[k].*value;
}

/// A surface is level if its height explains more of the samples than its range does.
void learn_cell(BackgroundModel& model, std::size_t cell, std::span<Sample> samples) {
  const BackgroundGrid& grid = model.grid;
  const float range = quantile(samples, 1 - grid.far_share, &Sample::range);
  const float z = quantile(samples, grid.far_share, &Sample::z);
  const auto near_range = std::ranges::count_if(
      samples, [&](const Sample& s) { return s.range >= range - grid.range_margin_m; });
  const auto near_height = std::ranges::count_if(
      samples, [&](const Sample& s) { return s.z <= z + grid.height_margin_m; });
  model.range_m[cell] = range;
  if (z < 0 && near_height > near_range) model.height_m[cell] = z;
}

/// Gives unseen cells the farthest and lowest of their eight neighbours.
void fill_unseen(BackgroundModel& model) {
  const std::vector<float> range = model.range_m, height = model.height_m;
  for (int e = 1; e + 1 < model.elevation_cells; ++e)
    for (int a = 0; a < model.azimuth_cells; ++a) {
      const int cell = e * model.azimuth_cells + a;
      if (range[cell] != kUnseen) continue;
      float farthest = -kUnseen, lowest = kUnseen;
      for (int de = -1; de <= 1; ++de)
        for (int da = -1; da <= 1; ++da) {
          const int column = (a + da + model.azimuth_cells) % model.azimuth_cells;
          const int near = (e + de) * model.azimuth_cells + column;
          if (range[near] == kUnseen) continue;
          farthest = std::max(farthest, range[near]);
          lowest = std::min(lowest, height[near]);
        }
      if (farthest == -kUnseen) continue;
      model.range_m[cell] = farthest;
      model.height_m[cell] = lowest;
    }
}

}  // namespace

BackgroundModel empty_background(const BackgroundGrid& grid) {
  const auto is_cell = [](double cell_deg) { return cell_deg >= 0.05 && cell_deg <= 10; };
  if (!is_cell(grid.azimuth_cell_deg) || !is_cell(grid.elevation_cell_deg))
    throw std::invalid_argument("background: cells must lie in [0.05, 10] degrees");
  if (!(grid.range_margin_m >= 0 && grid.height_margin_m >= 0 &&
        std::isfinite(grid.range_margin_m + grid.height_margin_m)))
    throw std::invalid_argument("background: margins must not be negative");
  if (!(grid.far_share >= 0 && grid.far_share <= 0.5))
    throw std::invalid_argument("background: far_share must lie in [0, 0.5]");
  BackgroundModel model{.grid = grid, .range_m = {}, .height_m = {}};
  model.azimuth_cells = static_cast<int>(std::lround(360 / grid.azimuth_cell_deg));
  model.elevation_cells = static_cast<int>(std::lround(180 / grid.elevation_cell_deg));
  const auto cells = static_cast<std::size_t>(model.azimuth_cells) * model.elevation_cells;
  model.range_m.assign(cells, kUnseen);
  model.height_m.assign(cells, -kUnseen);
  return model;
}

BackgroundModel learn_background(std::span<const std::vector<float>> frames_xyz,
                                 const BackgroundGrid& grid) {
  if (frames_xyz.empty()) throw std::invalid_argument("background: at least one frame is needed");
  BackgroundModel model = empty_background(grid);
  CellSamples cells = sort_by_cell(frames_xyz, model);
  for (std::size_t c = 0; c + 1 < cells.begin.size(); ++c) {
    const std::size_t n = cells.begin[c + 1] - cells.begin[c];
    if (n > 0) learn_cell(model, c, std::span(cells.samples).subspan(cells.begin[c], n));
  }
  fill_unseen(model);
  return model;
}

std::vector<int> keep(std::span<const float> xyz, const BackgroundModel& model) {
  return keep_if(xyz, [&](Vec3 p) {
    const int cell = cell_of(model, p);
    return norm(p) < model.range_m[cell] - model.grid.range_margin_m &&
           p.z > model.height_m[cell] + model.grid.height_margin_m;
  });
}

}  // namespace infrasim
