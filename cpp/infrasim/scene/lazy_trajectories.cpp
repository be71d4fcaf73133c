#include "infrasim/scene/lazy_trajectories.h"

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
  if (rows_around(from, steps_count_).first < first_) {
    keeps_all_ = true;
    restart();
  }
  advance_to(rows_around(to, steps_count_).second);
  const RowOf row = [&](int k) -> const std::vector<ObjectState>& {
    return rows_[static_cast<std::size_t>(k - first_)];
  };
  return with_standing(
      objects_between(states_at(from, steps_count_, row), states_at(to, steps_count_, row)),
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
  return rows_.size();
}

void LazyTrajectories::restart() {
  rows_.clear();
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
  while (!keeps_all_ && states_ > most_ && rows_.size() > kFewestRows) {
    states_ -= rows_.front().size();
    rows_.pop_front();
    ++first_;
  }
}

}  // namespace infrasim
