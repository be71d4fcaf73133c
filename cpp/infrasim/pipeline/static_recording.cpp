#include "infrasim/pipeline/static_recording.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "infrasim/config/fields.h"
#include "infrasim/core/classes.h"
#include "infrasim/core/errors.h"
#include "infrasim/core/math.h"
#include "infrasim/io/kitti.h"
#include "infrasim/pipeline/static_units.h"

namespace infrasim {

namespace {

constexpr std::size_t kFewestFrames = 20, kMostFrames = 100;
constexpr double kMostMiss_deg = 0.1;
// metres, maximum range difference in a group of returns; 6 standard deviations of the range noise
// if that is more
constexpr double kAgree_m = 0.3;
constexpr double kColumnReach =
    // maximum azimuth difference between a ray and its return, in columns
    0.75;
// minimum length of the mean phase vector (0 to 1) for a constant azimuth offset; 0.7 corresponds
// to a spread of an eighth of a column
constexpr double kConstantEnough = 0.7;

struct RecordedReturn {
  float azimuth;  ///< azimuth in the unit's frame, radians
  float range;
  float intensity;
};

/// One laser and its returns.
struct RecordedLaser {
  double elevation = 0;
  double reach = 0;  ///< maximum azimuth difference between a ray and its return, radians
  std::vector<std::pair<double, std::size_t>> rays;  ///< azimuth and index of each ray, ascending
  std::vector<std::vector<RecordedReturn>> frames;   ///< returns by frame, ascending in azimuth
  double sum_of_misses = 0;
  std::size_t points = 0;
};

struct Unit {
  Mat3 from_levelled;
  double agree_m = 0;  ///< maximum range difference in a group of returns, metres
  std::vector<RecordedLaser> rings;
  /// sums of the cosine and sine of the phases of all points; a phase is an angle, 0 to 2 pi, that
  /// states the position of a point between two columns
  double grid_cos = 0, grid_sin = 0;
  std::size_t points = 0;

  /// Returns the number of columns in a period. This is the maximum over the lasers, because some
  /// lasers do not fire in every column.
  double columns() const {
    std::size_t most = 0;
    for (const RecordedLaser& ring : rings) most = std::max(most, ring.rays.size());
    return static_cast<double>(most);
  }
  /// Returns the azimuth offset of the recorded columns, if it is constant.
  std::optional<double> offset() const {
    const bool constant =
        math::hypot(grid_cos, grid_sin) > kConstantEnough * static_cast<double>(points);
    return constant ? std::optional(math::atan2(grid_sin, grid_cos) / columns()) : std::nullopt;
  }
};

Mat3 transposed(const Mat3& m) { return {m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]}; }

double azimuth(Vec3 v) { return math::atan2(v.y, v.x); }

/// Returns the directions of a unit's lasers, by ring.
std::vector<RecordedLaser> rings_of(const ScanPattern& pattern, const SpinningConfig& spinning) {
  const std::int64_t size = pattern.group_size();
  RayBatch first;
  pattern.generate({0, size}, 0, first);
  const auto lowest = *std::ranges::min_element(first.ring);
  std::vector<RecordedLaser> rings(static_cast<std::size_t>(pattern.rings()));
  for (std::int64_t i = 0; i < pattern.repeats_after() * size; ++i) {
    RecordedLaser& ring = rings[first.ring[static_cast<std::size_t>(i % size)] - lowest];
    const Vec3 direction = pattern.ray(i).direction;
    ring.elevation = math::asin(direction.z);
    ring.rays.emplace_back(azimuth(direction), static_cast<std::size_t>(i));
  }
  const double column = 2 * kPi / columns_per_turn(spinning)->value();
  const std::vector<Channel> channels = channels_by_ring(spinning);
  for (std::size_t r = 0; r < rings.size(); ++r) {
    std::ranges::sort(rings[r].rays);
    rings[r].reach = kColumnReach * column * channels[r].column_step;
  }
  return rings;
}

std::vector<Unit> units_of(const SceneConfig& scene, const LidarConfig& lidar,
                           std::span<const ScannerUnit> scanners) {
  std::vector<Unit> units;
  for (std::size_t i = 0; i < scanners.size(); ++i) {
    const auto& spinning = lidar.units[i].pattern.spinning;
    if (!spinning)
      throw ConfigError(words_of(lidar) + ": unit " + std::to_string(i) +
                        ": expected a spinning LiDAR, for a recording, got a table of rays");
    units.push_back({.from_levelled = transposed(unit_pose(scene, lidar.units[i])),
                     .agree_m = std::max(kAgree_m, 6 * lidar.units[i].returns.range_accuracy_m),
                     .rings = rings_of(scanners[i].pattern, *spinning)});
  }
  return units;
}

/// Returns the numbers of the frames to read, ascending.
std::vector<int> frames_of(const std::filesystem::path& folder) {
  std::vector<int> all = frames_on_disk(folder);
  if (all.size() < kFewestFrames)
    throw ConfigError(folder.string() + ": expected " + std::to_string(kFewestFrames) +
                      " or more frames, got " + std::to_string(all.size()));
  std::vector<int> some;
  const std::size_t n = std::min(all.size(), kMostFrames);
  for (std::size_t i = 0; i < n; ++i) some.push_back(all[i * all.size() / n]);
  return some;
}

void take_point(Unit& unit, RecordedLaser& ring, Vec3 levelled, float intensity) {
  const double range = norm(levelled);
  if (!(range > 0) || !std::isfinite(range)) return;
  const Vec3 direction = unit.from_levelled * (1 / range * levelled);
  const double at = azimuth(direction);
  const double between = (at - ring.rays.front().first) * unit.columns();
  unit.grid_cos += math::cos(between);
  unit.grid_sin += math::sin(between);
  ++unit.points;
  ring.sum_of_misses += std::abs(math::asin(std::clamp(direction.z, -1.0, 1.0)) - ring.elevation);
  ++ring.points;
  ring.frames.back().push_back({static_cast<float>(at), static_cast<float>(range), intensity});
}

/// Returns the unit and the ring that a ring number stands for. Rings are numbered over all units.
/// The pointers are null if the number is too large.
std::pair<Unit*, RecordedLaser*> find_ring(std::vector<Unit>& units, std::size_t number) {
  for (Unit& unit : units) {
    if (number < unit.rings.size()) return {&unit, &unit.rings[number]};
    number -= unit.rings.size();
  }
  return {};
}

void take_frame(const std::filesystem::path& folder, int frame, std::vector<Unit>& units) {
  for (Unit& unit : units)
    for (RecordedLaser& ring : unit.rings) ring.frames.emplace_back();
  const RecordedPoints points = read_points(folder, frame);
  for (std::size_t i = 0; i < points.ring.size(); ++i) {
    const auto [unit, ring] = find_ring(units, points.ring[i]);
    if (ring == nullptr)
      throw ConfigError(folder.string() + ": frame " + frame_name(frame) + ", point " +
                        std::to_string(i) +
                        ": ring: expected the number of a laser, counted from 0, got " +
                        std::to_string(points.ring[i]));
    if (const float v = points.intensity[i]; !(v >= 0 && v <= 1))
      throw ConfigError(folder.string() + ": frame " + frame_name(frame) + ", point " +
                        std::to_string(i) + ": intensity: expected 0 to 1, got " +
                        (std::isnan(v) ? "nan" : config::number_text(v)));
    const float* p = &points.xyz[3 * i];
    take_point(*unit, *ring, {p[0], p[1], p[2]}, points.intensity[i]);
  }
  for (Unit& unit : units)
    for (RecordedLaser& ring : unit.rings)
      std::ranges::sort(ring.frames.back(), {}, &RecordedReturn::azimuth);
}

/// @return mean elevation error of the ring with the largest mean error, degrees
double check_elevations(const std::filesystem::path& folder, const LidarConfig& lidar,
                        const std::vector<Unit>& units) {
  double worst = 0;
  std::size_t number = 0, worst_ring = 0;
  for (const Unit& unit : units)
    for (const RecordedLaser& ring : unit.rings) {
      const double miss =
          ring.points > 0 ? deg(ring.sum_of_misses / static_cast<double>(ring.points)) : 0;
      if (miss > worst) worst = miss, worst_ring = number;
      ++number;
    }
  if (worst <= kMostMiss_deg) return worst;
  throw ConfigError(folder.string() + ": ring " + std::to_string(worst_ring) +
                    ": expected elevations within " + config::number_text(kMostMiss_deg) +
                    " degrees of those of " + words_of(lidar) + ", got a mean difference of " +
                    config::number_text(std::round(worst * 1000) / 1000) +
                    " degrees; check the channels in the LiDAR's file, and pitch and roll of the "
                    "mount");
}

/// Finds the return that is nearest to an azimuth. The result is null if no return is within
/// `reach`.
const RecordedReturn* nearest(const std::vector<RecordedReturn>& echoes, double at, double reach) {
  if (echoes.empty()) return nullptr;
  const auto after =
      std::ranges::lower_bound(echoes, static_cast<float>(at), {}, &RecordedReturn::azimuth);
  const RecordedReturn& b = after == echoes.end() ? echoes.front() : *after;
  const RecordedReturn& a = after == echoes.begin() ? echoes.back() : *(after - 1);
  const auto away = [&](const RecordedReturn& e) { return std::abs(wrap_angle(e.azimuth - at)); };
  const RecordedReturn& best = away(b) < away(a) ? b : a;
  return away(best) <= reach ? &best : nullptr;
}

/// Returns the mean of the largest group of returns within `extent_m`. Of equally large groups, the
/// group with the shortest range is used. Returns no value if the number of returns in the group is
/// less than half of the number of frames.
std::optional<RecordedReturn> agreed(std::vector<RecordedReturn>& seen, double extent_m,
                                     std::size_t frames) {
  std::ranges::sort(seen, {}, &RecordedReturn::range);
  std::size_t first = 0, most = 0;
  for (std::size_t a = 0, b = 0; b < seen.size(); ++b) {
    while (seen[b].range - seen[a].range > extent_m) ++a;
    if (b + 1 - a > most) most = b + 1 - a, first = a;
  }
  if (most == 0 || 2 * most < frames) return std::nullopt;
  double range = 0, intensity = 0;
  for (std::size_t i = first; i < first + most; ++i) {
    range += seen[i].range;
    intensity += seen[i].intensity;
  }
  const auto n = static_cast<double>(most);
  return RecordedReturn{0, static_cast<float>(range / n), static_cast<float>(intensity / n)};
}

/// Sets the hits of all rays of a unit.
/// @return number of rays with a return beyond the LiDAR's range
std::size_t fill(const Unit& unit, StaticHits& hits) {
  const double offset = unit.offset().value_or(0);
  std::size_t too_far = 0;
  std::vector<RecordedReturn> seen;
  for (const RecordedLaser& ring : unit.rings)
    for (const auto& [at, ray] : ring.rays) {
      seen.clear();
      for (const auto& frame : ring.frames)
        if (const RecordedReturn* echo = nearest(frame, wrap_angle(at + offset), ring.reach))
          seen.push_back(*echo);
      const auto echo = agreed(seen, unit.agree_m, ring.frames.size());
      if (!echo) continue;
      if (echo->range > hits.max_range_m) {
        ++too_far;
        continue;
      }
      hits.range_m[ray] = echo->range;
      hits.gain[ray] = echo->intensity;
      hits.class_id[ray] = static_cast<std::uint16_t>(Class::kRecorded);
    }
  return too_far;
}

}  // namespace

RecordedLayer recorded_static_layer(const SceneConfig& scene, const LidarConfig& lidar,
                                    const std::filesystem::path& folder) {
  const std::vector<ScannerUnit> scanners = make_scanner_units(scene, lidar);
  RecordedLayer out;
  out.units = units_without_hits(lidar, scanners);
  std::vector<Unit> units = units_of(scene, lidar, scanners);
  for (const int frame : frames_of(folder)) {
    take_frame(folder, frame, units);
    ++out.frames;
  }
  out.elevation_miss_deg = check_elevations(folder, lidar, units);
  for (std::size_t i = 0; i < units.size(); ++i) {
    out.azimuth_offsets_deg.push_back(deg(units[i].offset().value_or(0)));
    out.too_far += fill(units[i], out.units[i]);
  }
  return out;
}

}  // namespace infrasim
