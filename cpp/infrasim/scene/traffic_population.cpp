#include "infrasim/scene/traffic_population.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "infrasim/config/fields.h"
#include "infrasim/scene/driver.h"
#include "infrasim/scene/fleet.h"

namespace infrasim {

namespace {

// m, maximum offset of a vehicle from the lane's centre; the offset is constant in time
constexpr double kMaxLateral = 0.3;

/// Returns the distance between the centres of two vehicles in a queue.
double spacing(const Vehicle& v, const Vehicle& ahead) {
  return (v.dx + ahead.dx) / 2 + kStandstillGap_m;
}

}  // namespace

TrafficPopulation::TrafficPopulation(const TrafficConfig& config, std::uint64_t seed,
                                     TrafficState& state)
    : config_(config), state_(state), rng_(Rng::of(seed, "traffic")) {
  for (std::size_t i = 0; i < state.network.lanes.size(); ++i) {
    const Lane& lane = state.network.lanes[i];
    if (lane.entry) entries_.push_back(static_cast<int>(i));
    narrowest_m_ = std::min(narrowest_m_, lane.width_m);
    if (lane.turn == Turn::kStraight && !state.is_on_ring(lane))
      tightest_radius_ = std::min(tightest_radius_, lane.curve.tightest_radius());
  }
  for (const auto& [name, share] : config_.class_shares)
    if (share > 0) check_fits(*find_class(name));
}

void TrafficPopulation::fill() {
  for (std::size_t i = 0; i < state_.network.lanes.size(); ++i) {
    const Lane& lane = state_.network.lanes[i];
    if (lane.junction >= 0) continue;
    const double length = lane.curve.length();
    density_carry_ += config_.vehicles_per_km_lane * length / 1000;
    const int count = static_cast<int>(density_carry_);
    density_carry_ -= count;
    for (int k = count - 1; k >= 0; --k) {
      Vehicle v = new_vehicle(static_cast<int>(i));
      v.s = length * (k + 0.5) / count;
      if (!state_.lanes[i].empty())
        v.s = std::min(v.s, state_.lanes[i].back().s - spacing(v, state_.lanes[i].back()));
      v.speed = speed_at_start(v, v.desired_speed / 2);
      if (v.s < v.dx / 2)
        ++waiting_;
      else
        state_.lanes[i].push_back(v);
    }
  }
}

/// Returns the desired speed, reduced so that the vehicle can stop at the signal ahead.
double TrafficPopulation::speed_at_start(const Vehicle& v, double desired) const {
  if (state_.lane_of(v).approach < 0) return desired;
  return std::min(desired, std::sqrt(2 * kBraking * std::max(0.0, state_.to_stop_line(v))));
}

Vehicle TrafficPopulation::new_vehicle(int lane) {
  const Rng rng = rng_.at(static_cast<std::uint64_t>(next_id_) + 1);
  Vehicle v;
  v.id = next_id_++;
  v.lane = lane;
  v.object_class = &class_at(config_.class_shares, rng.uniform(0));
  const VehicleSize size = sample_size(*v.object_class, rng);
  v.dx = size.dx;
  v.dy = size.dy;
  v.dz = size.dz;
  const double deviation = std::clamp(rng.normal(7), -2.5, 2.5);
  v.desired_speed =
      std::max(1.0, (config_.speed.mean_km_h + config_.speed.std_km_h * deviation) / 3.6);
  const double free_width =
      std::clamp((state_.network.lanes[lane].width_m - v.dy) / 2 - 0.25, 0.0, kMaxLateral);
  v.lateral = free_width * (2 * rng.uniform(9) - 1);
  fit_lanes(v);
  v.turn_choice = rng.uniform(10);
  return v;
}

void TrafficPopulation::check_fits(const ObjectClass& row) const {
  Vehicle v;
  v.dx = row.length_m.mean;
  v.dy = row.width_m.mean;
  if (half_width_in_bend(v, tightest_radius_, 0) <= narrowest_m_ / 2) return;
  const auto metres = [](double m) { return config::number_text(std::round(100 * m) / 100); };
  config::fail(config_.place, "class_shares",
               "expected vehicles that stay in the narrowest lane, " + metres(narrowest_m_) +
                   " m, round the tightest bend, " + metres(tightest_radius_) + " m, got " +
                   std::string(row.name));
}

/// Makes a vehicle narrower and moves it to the lane's centre, if it would otherwise leave its lane
/// in the scene's tightest bend. In the bend, another long vehicle may be on the next lane.
void TrafficPopulation::fit_lanes(Vehicle& v) const {
  const double beside = half_width_in_bend(v, tightest_radius_, 0) - v.dy / 2;
  v.dy = std::min(v.dy, narrowest_m_ - 2 * beside);
  const double free_width = narrowest_m_ / 2 - v.dy / 2 - beside;
  v.lateral = std::clamp(v.lateral, -free_width, free_width);
}

void TrafficPopulation::spawn() {
  for (std::size_t n = waiting_; n > 0; --n) {
    const int lane = entries_[rng_.at(1'000'000'001ULL + spawn_draws_++).bits(0) % entries_.size()];
    Vehicle v = new_vehicle(lane);
    v.s = v.dx / 2;
    v.speed = speed_at_start(v, v.desired_speed);
    if (!state_.lanes[lane].empty()) {
      const Vehicle& ahead = state_.lanes[lane].back();
      const double gap = ahead.s - ahead.dx / 2 - v.dx;
      v.speed = std::min(v.speed, ahead.speed);
      if (gap < kStandstillGap_m + kTimeGap * v.speed) {
        --next_id_;
        continue;
      }
    }
    state_.lanes[lane].push_back(v);
    --waiting_;
  }
}

}  // namespace infrasim
