#include "infrasim/scene/lazy_trajectories.h"

#include <algorithm>
#include <array>
#include <utility>

#include "infrasim/scene/sensor_rules.h"

namespace infrasim {

namespace {

// Minimum number of rows that are kept: three for a frame of 0.2 s, and one more for a clock
// offset.
constexpr std::size_t kFewestRows = 4;

}  // namespace

LazyTrajectories::LazyTrajectories(std::shared_ptr<const Site> site, std::size_t most)
    : site_(std::move(site)),
      source_(*site_),
      most_(most),
      steps_count_(row_steps(site_->scene.duration_s)) {
  restart();
}

std::vector<MovingObject> LazyTrajectories::between(double from, double to) {
  const std::lock_guard lock(mutex_);
  const auto [first, second] = rows_around(from, steps_count_);
  const auto [third, last] = rows_around(to, steps_count_);
  const std::array needed{first, second, third, last};
  if (!std::ranges::all_of(needed, [&](int k) { return has(k); })) {
    keeps_all_ = true;
    restart();
  }
  requested_.insert(needed.begin(), needed.end());
  advance_to(last);
  const RowOf row_of = [&](int k) -> const std::vector<ObjectState>& { return row(k); };
  return with_standing(
      objects_between(states_at(from, steps_count_, row_of), states_at(to, steps_count_, row_of)),
      source_.standing());
}

void LazyTrajectories::drive() {
  const std::lock_guard lock(mutex_);
  advance_to(steps_count_);
}

int LazyTrajectories::simulated() const {
  const std::lock_guard lock(mutex_);
  return instant_;
}

std::size_t LazyTrajectories::kept() const {
  const std::lock_guard lock(mutex_);
  return rows_.size() + kept_.size();
}

/// Returns whether a row is in memory, or is still to be simulated.
bool LazyTrajectories::has(int row) const { return row >= first_ || kept_.contains(row); }

const std::vector<ObjectState>& LazyTrajectories::row(int k) const {
  return k < first_ ? kept_.at(k) : rows_[static_cast<std::size_t>(k - first_)];
}

void LazyTrajectories::restart() {
  rows_.clear();
  requested_.clear();
  kept_.clear();
  kept_states_ = 0;
  first_ = instant_ = 0;
  states_ = 0;
  error_ = nullptr;
  steps_.emplace(source_);
}

void LazyTrajectories::advance_to(int row) {
  while (first_ + static_cast<int>(rows_.size()) <= row) {
    if (error_) std::rethrow_exception(error_);
    try {
      advance();
    } catch (...) {
      error_ = std::current_exception();
    }
  }
}

void LazyTrajectories::advance() {
  if (instant_ == 0) check_sensor_is_free(site_->scene, source_.standing(), 0);
  std::vector<ObjectState> states = steps_->next_moving();
  check_sensor_is_free(site_->scene, states, instant_++);
  states_ += states.size();
  rows_.push_back(std::move(states));
  while (!keeps_all_ && states_ > most_ && rows_.size() > kFewestRows) drop_first();
}

void LazyTrajectories::drop_first() {
  const std::size_t size = rows_.front().size();
  if (requested_.erase(first_) > 0 && kept_states_ + size <= most_) {
    kept_.emplace(first_, std::move(rows_.front()));
    kept_states_ += size;
  }
  states_ -= size;
  rows_.pop_front();
  ++first_;
}

}  // namespace infrasim
