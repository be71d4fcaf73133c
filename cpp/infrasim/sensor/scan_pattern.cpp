#include "infrasim/sensor/scan_pattern.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "infrasim/core/math.h"

namespace infrasim {

namespace {

constexpr int kTileSide = 4;
// maximum number of groups for which results of `turn` are stored
constexpr std::int64_t kMostTurns = 1 << 17;

double positive_fmod(double value, double period) {
  const double r = std::fmod(value, period);
  return r < 0 ? r + period : r;
}

/// Returns the indices of the elevations, in increasing order of elevation. Equal elevations keep
/// their order.
std::vector<std::uint32_t> ascending(const std::vector<double>& elevations) {
  std::vector<std::uint32_t> order(elevations.size());
  std::iota(order.begin(), order.end(), 0U);
  std::ranges::stable_sort(order, {}, [&](std::uint32_t i) { return elevations[i]; });
  return order;
}

}  // namespace

ScanPattern::ScanPattern(const PatternConfig& config, double phase_s, const Mat3& unit_pose,
                         int first_ring)
    : config_(config), phase_s_(phase_s), pose_{}, pose_exact_(unit_pose) {
  std::ranges::transform(unit_pose, pose_.begin(), [](double v) { return static_cast<float>(v); });
  std::vector<double> elevations{0};
  if (config_.spinning) {
    add_lasers();
    elevations.clear();
    for (const Channel& c : config_.spinning->channels.table) elevations.push_back(c.elevation_deg);
    start_deg_ = positive_fmod(
        360 * config_.spinning->rate_hz * phase_s - config_.spinning->cut_angle_deg, 360);
    if (groups_per_turn_ && groups_per_turn_->numerator <= kMostTurns) {
      std::vector<std::pair<float, float>> turns;
      for (std::int64_t group = 0; group < groups_per_turn_->numerator; ++group)
        turns.push_back(turn(group));
      turns_ = std::move(turns);
    }
  } else if (config_.prisms) {
    elevations = config_.prisms->laser_offsets;
    groups_per_s_ = config_.prisms->steps_per_s;
    for (const PrismConfig& prism : config_.prisms->prisms)
      tilts_.push_back(math::cos_sin(rad(prism.angle_deg)));
    for (const double offset : elevations) {
      const double e = math::atan(offset / config_.prisms->focal_length);
      lasers_of_step_.x.push_back(math::cos(e));
      lasers_of_step_.y.push_back(0);
      lasers_of_step_.z.push_back(math::sin(e));
    }
  } else {
    groups_per_s_ = config_.table->rays_per_s;
    first_row_ = static_cast<std::int64_t>(phase_s * groups_per_s_);
  }
  rings_ = static_cast<int>(elevations.size());
  std::vector<std::uint16_t> ring_of(elevations.size());
  const std::vector<std::uint32_t> order = ascending(elevations);
  for (std::size_t r = 0; r < order.size(); ++r)
    ring_of[order[r]] = static_cast<std::uint16_t>(first_ring + static_cast<int>(r));
  if (shots_.empty()) ring_ = ring_of;
  for (const Shot& shot : shots_) ring_.push_back(ring_of[shot.channel]);
  group_size_ = static_cast<int>(ring_.size());
  members_by_ring_.resize(ring_.size());
  std::iota(members_by_ring_.begin(), members_by_ring_.end(), 0U);
  std::ranges::stable_sort(members_by_ring_, {}, [&](std::uint32_t i) { return ring_[i]; });
}

/// Adds the lasers of a spinning unit's group, column by column.
void ScanPattern::add_lasers() {
  const SpinningConfig& s = *config_.spinning;
  const int columns = columns_per_group(s);
  groups_per_s_ = columns_per_s(s) / columns;
  if (const auto per_turn = columns_per_turn(s)) {
    const std::int64_t divisor = std::gcd(per_turn->numerator, std::int64_t{columns});
    groups_per_turn_ =
        Fraction{per_turn->numerator / divisor, per_turn->denominator * (columns / divisor)};
  }
  const std::vector<Channel>& channels = s.channels.table;
  for (int column = 0; column < columns; ++column)
    for (std::uint32_t i = 0; i < channels.size(); ++i) {
      const Channel& c = channels[i];
      if (column % c.column_step != c.first_column) continue;
      const double fire_time = column / columns_per_s(s) + c.fire_time_us * 1e-6;
      // The unit turns while a group fires. A channel that fires later therefore has an additional
      // azimuth offset.
      shots_.push_back(
          {i, c.elevation_deg, c.azimuth_offset_deg + 360 * s.rate_hz * fire_time, fire_time});
      const double e = rad(c.elevation_deg), shift = -rad(shots_.back().shift_deg);
      lasers_.push_back({static_cast<float>(math::cos(e)), static_cast<float>(math::sin(e)),
                         static_cast<float>(math::cos(shift)), static_cast<float>(math::sin(shift)),
                         static_cast<float>(fire_time)});
    }
}

RayRange ScanPattern::fired_between(double from_s, double to_s) const {
  if (config_.table && !config_.table->times_s.empty()) {
    const auto row_at = [&](double t) {
      const std::vector<double>& times = config_.table->times_s;
      const double since = t + table_time(first_row_) - 1e-6 / groups_per_s_;
      const double cycle = std::floor(since / cycle_s());
      const auto row = std::ranges::lower_bound(times, since - cycle * cycle_s());
      const std::int64_t rows = static_cast<std::int64_t>(cycle) * repeats_after();
      // Without max, the number could be negative, as several rows may have the first row's time.
      return std::max<std::int64_t>(0, rows + (row - times.begin()) - first_row_);
    };
    return {row_at(from_s), row_at(to_s)};
  }
  // The tolerance puts a group that starts exactly at the end of a range into the next range.
  const auto group_at = [&](double t) {
    return static_cast<std::int64_t>(std::ceil(t * groups_per_s_ - 1e-6));
  };
  return {group_at(from_s) * group_size_, group_at(to_s) * group_size_};
}

bool ScanPattern::spins() const { return config_.spinning.has_value(); }

double ScanPattern::cycle_s() const {
  if (config_.spinning) return 1 / config_.spinning->rate_hz;
  if (config_.table)
    return static_cast<double>(config_.table->directions.size()) / config_.table->rays_per_s;
  return 1;
}

std::int64_t ScanPattern::repeats_after() const {
  if (config_.table) return static_cast<std::int64_t>(config_.table->directions.size());
  return groups_per_turn_ ? groups_per_turn_->numerator : 0;
}

/// Returns the angle by which a unit has turned at the start of a group, 0 to 360 degrees.
double ScanPattern::group_deg(std::int64_t group) const {
  if (!groups_per_turn_) {
    const SpinningConfig& s = *config_.spinning;
    const double step_deg = s.azimuth_step_deg ? *s.azimuth_step_deg * columns_per_group(s)
                                               : 360 * s.rate_hz / groups_per_s_;
    return positive_fmod(static_cast<double>(group) * step_deg, 360);
  }
  const std::int64_t n = groups_per_turn_->numerator;
  return 360 * static_cast<double>(group % n * (groups_per_turn_->denominator % n) % n) /
         static_cast<double>(n);
}

Ray ScanPattern::ray(std::int64_t index) const {
  const std::int64_t group = index / group_size_;
  const int member = static_cast<int>(index % group_size_);
  if (config_.spinning) return spinning_ray(group, member);
  if (config_.prisms) return prism_ray(group, member);
  return table_ray(group);
}

Ray ScanPattern::spinning_ray(std::int64_t group, int member) const {
  const Shot& shot = shots_[static_cast<std::size_t>(member)];
  const double turned_deg = group_deg(group) + start_deg_ + shot.shift_deg;
  const double azimuth = -rad(std::fmod(turned_deg, 360)), elevation = rad(shot.elevation_deg);
  return {{math::cos(elevation) * math::cos(azimuth), math::cos(elevation) * math::sin(azimuth),
           math::sin(elevation)},
          static_cast<double>(group) / groups_per_s_ + shot.fire_time_s};
}

double ScanPattern::optical_time(std::int64_t group) const {
  return static_cast<double>(group + config_.prisms->first_step) / groups_per_s_ + phase_s_;
}

Ray ScanPattern::prism_ray(std::int64_t group, int member) const {
  DirectionBatch directions;
  trace(config_.prisms->prisms, tilts_, lasers_of_step_, optical_time(group), directions);
  const auto i = static_cast<std::size_t>(member);
  return {{directions.x[i], directions.y[i], directions.z[i]},
          static_cast<double>(group) / groups_per_s_};
}

Ray ScanPattern::table_ray(std::int64_t group) const {
  const TableConfig& table = *config_.table;
  const Vec2 d = table.directions[static_cast<std::size_t>((group + first_row_) % repeats_after())];
  return {{math::cos(d.y) * math::cos(d.x), math::cos(d.y) * math::sin(d.x), math::sin(d.y)},
          table.times_s.empty() ? static_cast<double>(group) / groups_per_s_
                                : table_time(group + first_row_) - table_time(first_row_)};
}

/// Returns the firing time of a row of a table with times. Rows are counted over all repetitions.
double ScanPattern::table_time(std::int64_t row) const {
  const std::int64_t rows = repeats_after();
  const std::int64_t cycles = row / rows;
  return static_cast<double>(cycles) * cycle_s() +
         config_.table->times_s[static_cast<std::size_t>(row % rows)];
}

void ScanPattern::generate(RayRange range, double start_s, RayBatch& rays) const {
  rays.number.resize(static_cast<std::size_t>(range.size()));
  std::iota(rays.number.begin(), rays.number.end(), 0U);
  rays.resize(rays.number.size());
  generate(range.first / group_size_, start_s, rays.number, rays);
}

void ScanPattern::generate(std::int64_t first_group, double start_s,
                           std::span<const std::uint32_t> which, RayBatch& rays) const {
  if (config_.spinning) return generate_columns(first_group, start_s, which, rays);
  if (config_.prisms) return generate_steps(first_group, start_s, which, rays);
  for (const std::uint32_t k : which) {
    const Ray ray = table_ray(first_group + rays.number[k]);
    put(k, ray.direction, ray.time_s - start_s, 0, rays);
  }
}

void ScanPattern::put(std::size_t k, Vec3 direction, double time_s, int member,
                      RayBatch& rays) const {
  const Vec3 d = pose_exact_ * direction;
  rays.dx[k] = static_cast<float>(d.x);
  rays.dy[k] = static_cast<float>(d.y);
  rays.dz[k] = static_cast<float>(d.z);
  rays.time[k] = std::max(0.0F, static_cast<float>(time_s));
  rays.ring[k] = ring_[static_cast<std::size_t>(member)];
}

void ScanPattern::generate_steps(std::int64_t first_group, double start_s,
                                 std::span<const std::uint32_t> which, RayBatch& rays) const {
  DirectionBatch directions;
  std::int64_t traced = -1;  // group that `directions` belongs to
  for (const std::uint32_t k : which) {
    const std::int64_t group = first_group + rays.number[k] / group_size_;
    if (group != traced)
      trace(config_.prisms->prisms, tilts_, lasers_of_step_, optical_time(group), directions);
    traced = group;
    const auto i = rays.number[k] % static_cast<std::uint32_t>(group_size_);
    put(k, {directions.x[i], directions.y[i], directions.z[i]},
        static_cast<double>(group) / groups_per_s_ - start_s, static_cast<int>(i), rays);
  }
}

/// Returns the cosine and sine of the azimuth to which a unit has turned at the start of a group.
std::pair<float, float> ScanPattern::turn(std::int64_t group) const {
  if (!turns_.empty()) return turns_[static_cast<std::size_t>(group % groups_per_turn_->numerator)];
  const double azimuth = -rad(group_deg(group) + start_deg_);
  return {static_cast<float>(math::cos(azimuth)), static_cast<float>(math::sin(azimuth))};
}

void ScanPattern::set_rings(RayBatch& rays) const {
  for (std::size_t k = 0; k < rays.size(); ++k)
    rays.ring[k] = ring_[rays.number[k] % static_cast<std::uint32_t>(group_size_)];
}

void ScanPattern::generate_columns(std::int64_t first_group, double start_s,
                                   std::span<const std::uint32_t> which, RayBatch& rays) const {
  const auto& m = pose_;
  const auto size = static_cast<std::uint32_t>(group_size_);
  for (std::size_t n = 0; n < which.size();) {
    const std::uint32_t within = rays.number[which[n]] / size, begin = within * size;
    const std::int64_t group = first_group + within;
    const auto [ca, sa] = turn(group);
    const auto time =
        std::max(0.0F, static_cast<float>(static_cast<double>(group) / groups_per_s_ - start_s));
    for (; n < which.size() && rays.number[which[n]] < begin + size; ++n) {
      const std::uint32_t k = which[n], i = rays.number[k] - begin;
      const Laser& laser = lasers_[i];
      const float x = laser.cos_elevation * (ca * laser.cos_shift - sa * laser.sin_shift);
      const float y = laser.cos_elevation * (sa * laser.cos_shift + ca * laser.sin_shift);
      const float z = laser.sin_elevation;
      rays.dx[k] = m[0] * x + m[1] * y + m[2] * z;
      rays.dy[k] = m[3] * x + m[4] * y + m[5] * z;
      rays.dz[k] = m[6] * x + m[7] * y + m[8] * z;
      rays.time[k] = time + laser.fire_time;
      rays.ring[k] = ring_[i];
    }
  }
}

std::vector<std::uint32_t> ScanPattern::tile_order(int groups) const {
  std::vector<std::uint32_t> order;
  order.reserve(static_cast<std::size_t>(groups) * group_size_);
  if (!config_.spinning) {
    order.resize(static_cast<std::size_t>(groups) * group_size_);
    std::iota(order.begin(), order.end(), 0U);
    return order;
  }
  for (int g0 = 0; g0 < groups; g0 += kTileSide)
    for (int r0 = 0; r0 < group_size_; r0 += kTileSide)
      for (int g = g0; g < std::min(g0 + kTileSide, groups); ++g)
        for (int r = r0; r < std::min(r0 + kTileSide, group_size_); ++r)
          order.push_back(static_cast<std::uint32_t>(g * group_size_) + members_by_ring_[r]);
  return order;
}

std::vector<Channel> channels_by_ring(const SpinningConfig& spinning) {
  std::vector<double> elevations;
  for (const Channel& c : spinning.channels.table) elevations.push_back(c.elevation_deg);
  std::vector<Channel> channels;
  for (const std::uint32_t i : ascending(elevations))
    channels.push_back(spinning.channels.table[i]);
  return channels;
}

}  // namespace infrasim
