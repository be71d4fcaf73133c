#include "infrasim/filter/background.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "infrasim/core/math.h"
#include "infrasim/filter/points.h"

namespace infrasim {

namespace {

/// Share of a cell's returns that are farther than its background. The background is thus a
/// quantile of the ranges. It is found even if vehicles hide it in most frames, as in a queue at a
/// red light, and it does not depend on stray echoes.
constexpr double kFarShare = 0.1;
/// A cell has a background under two conditions. At least kAgreeingShare of its returns agree with
/// the background, and the cell has at least kSeenShare of the mean number of returns of the cells
/// below it. Neither condition holds in a cell whose beams only meet passing vehicles, with sky or
/// ground out of range behind them.
constexpr double kAgreeingShare = 0.2;
constexpr double kSeenShare = 0.5;

struct Sample {
  float range;
  float z;
};

int cell_of(const BackgroundModel& model, Vec3 p) {
  const double turn = math::atan2(p.y, p.x) / (2 * kPi) + 0.5;
  const double tilt = math::atan2(p.z, math::hypot(p.x, p.y)) / kPi + 0.5;
  // The azimuths of cell centres are multiples of the cell width, like most beams of spinning
  // sensors.
  const int a = static_cast<int>(std::lround(turn * model.azimuth_cells)) % model.azimuth_cells;
  const int e = std::min(static_cast<int>(tilt * model.elevation_cells), model.elevation_cells - 1);
  return e * model.azimuth_cells + a;
}

/// Returns the cell some steps away. The azimuth wraps around, and the elevation is clamped at the
/// poles.
int neighbour(const BackgroundModel& model, int cell, int azimuth_step, int elevation_step) {
  const int n = model.azimuth_cells;
  const int a = (cell % n + azimuth_step + n) % n;
  const int e = std::clamp(cell / n + elevation_step, 0, model.elevation_cells - 1);
  return e * n + a;
}

/// Samples of all frames, ordered by cell. The samples of cell c lie in [begin[c], begin[c + 1]).
struct CellSamples {
  std::vector<std::size_t> begin;
  std::vector<Sample> samples;

  std::size_t count(std::size_t cell) const { return begin[cell + 1] - begin[cell]; }
  std::span<Sample> of(std::size_t cell) {
    return std::span(samples).subspan(begin[cell], count(cell));
  }
};

template <class Use>
void for_each_point(std::span<const std::vector<float>> frames, Use use) {
  for (const std::vector<float>& xyz : frames)
    for (std::size_t i = 0; i < point_count(xyz); ++i)
      if (const Vec3 p = point_at(xyz, i); is_return(p)) use(p);
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

/// Returns the number of returns that a cell would have if all its rays had a return. It is the
/// mean over the cells with returns up to 5 degrees below the cell, where the rays hit the ground.
double expected_count(const BackgroundModel& model, const CellSamples& cells, int cell) {
  const int rows = std::max(1, 5 * model.elevation_cells / 180);
  std::size_t seen = 0, returns = 0;
  for (int c = cell; c >= 0 && c > cell - rows * model.azimuth_cells; c -= model.azimuth_cells) {
    seen += cells.count(c) > 0 ? 1 : 0;
    returns += cells.count(c);
  }
  return static_cast<double>(returns) / static_cast<double>(seen);
}

/// Returns the value below which a share of the samples lies.
float quantile(std::span<Sample> samples, double share, float Sample::* value) {
  const auto k =
      static_cast<std::size_t>(std::lround(share * static_cast<double>(samples.size() - 1)));
  std::ranges::nth_element(samples, samples.begin() + static_cast<std::ptrdiff_t>(k), {}, value);
  return samples[k].*value;
}

/// Learns a cell's background without margins. The surface in the cell is level if more returns
/// agree on the height than on the range.
void learn_cell(std::span<Sample> samples, const BackgroundLearning& learning, float& range_m,
                float& height_m) {
  const float range = quantile(samples, 1 - kFarShare, &Sample::range);
  const float z = quantile(samples, kFarShare, &Sample::z);
  const auto at_range = std::ranges::count_if(
      samples, [&](const Sample& s) { return s.range >= range - learning.range_margin_m; });
  const auto at_height = std::ranges::count_if(
      samples, [&](const Sample& s) { return s.z <= z + learning.height_margin_m; });
  const bool level = z < 0 && at_height > at_range;
  const double needed = kAgreeingShare * static_cast<double>(samples.size());
  if (static_cast<double>(level ? at_height : at_range) < needed) return;
  range_m = range;
  if (level) height_m = z;
}

/// Returns the change of range from a cell to the next one. The changes on both sides are combined
/// with the minmod limiter, so that the result is 0 if their signs differ.
float range_change(const BackgroundModel& model, int cell, int azimuth_step, int elevation_step) {
  const float ahead = model.range_m[neighbour(model, cell, azimuth_step, elevation_step)];
  const float behind = model.range_m[neighbour(model, cell, -azimuth_step, -elevation_step)];
  if (ahead == kUnseen || behind == kUnseen) return 0;
  const float to = ahead - model.range_m[cell], from = model.range_m[cell] - behind;
  return to * from > 0 ? std::min(std::abs(to), std::abs(from)) : 0;
}

void add_margins(BackgroundModel& model, const BackgroundLearning& learning) {
  std::vector<float> bound = model.range_m;
  for (int c = 0; c < static_cast<int>(bound.size()); ++c) {
    if (model.range_m[c] == kUnseen) continue;
    bound[c] -= static_cast<float>(learning.range_margin_m);
    if (model.height_m[c] == -kUnseen)
      bound[c] -= range_change(model, c, 1, 0) + range_change(model, c, 0, 1);
    model.height_m[c] += static_cast<float>(learning.height_margin_m);
  }
  model.range_m = std::move(bound);
}

/// Gives each cell without a background the farthest range and the lowest height of its eight
/// neighbours.
void fill_unseen(BackgroundModel& model) {
  const std::vector<float> range = model.range_m, height = model.height_m;
  for (int c = 0; c < static_cast<int>(range.size()); ++c) {
    if (range[c] != kUnseen) continue;
    float farthest = -kUnseen, lowest = kUnseen;
    for (int de = -1; de <= 1; ++de)
      for (int da = -1; da <= 1; ++da) {
        const int near = neighbour(model, c, da, de);
        if (range[near] == kUnseen) continue;
        farthest = std::max(farthest, range[near]);
        lowest = std::min(lowest, height[near]);
      }
    if (farthest == -kUnseen) continue;
    model.range_m[c] = farthest;
    model.height_m[c] = lowest;
  }
}

BackgroundModel empty_background(const BackgroundLearning& learning) {
  const auto is_cell = [](double cell_deg) { return cell_deg >= 0.05 && cell_deg <= 10; };
  if (!is_cell(learning.azimuth_cell_deg) || !is_cell(learning.elevation_cell_deg))
    throw std::invalid_argument("background: cells must lie in [0.05, 10] degrees");
  if (!(learning.range_margin_m >= 0 && learning.height_margin_m >= 0))
    throw std::invalid_argument("background: margins must not be negative");
  BackgroundModel model;
  model.azimuth_cells = static_cast<int>(std::lround(360 / learning.azimuth_cell_deg));
  model.elevation_cells = static_cast<int>(std::lround(180 / learning.elevation_cell_deg));
  const auto cells = static_cast<std::size_t>(model.azimuth_cells) * model.elevation_cells;
  model.range_m.assign(cells, kUnseen);
  model.height_m.assign(cells, -kUnseen);
  return model;
}

}  // namespace

BackgroundModel learn_background(std::span<const std::vector<float>> frames_xyz,
                                 const BackgroundLearning& learning) {
  if (frames_xyz.empty()) throw std::invalid_argument("background: at least one frame is needed");
  BackgroundModel model = empty_background(learning);
  CellSamples cells = sort_by_cell(frames_xyz, model);
  for (int c = 0; c < static_cast<int>(model.range_m.size()); ++c) {
    // If a cell has few returns, they come from passing vehicles without a surface behind them.
    const auto returns = static_cast<double>(cells.count(c));
    if (returns > 0 && returns >= kSeenShare * expected_count(model, cells, c))
      learn_cell(cells.of(c), learning, model.range_m[c], model.height_m[c]);
  }
  add_margins(model, learning);
  fill_unseen(model);
  return model;
}

std::vector<int> keep(std::span<const float> xyz, const BackgroundModel& model) {
  return keep_if(xyz, [&](Vec3 p) {
    const int cell = cell_of(model, p);
    return norm(p) < model.range_m[cell] && p.z > model.height_m[cell];
  });
}

}  // namespace infrasim
