#include "infrasim/scene/lazy_trajectories.h"

#include <utility>

#include "infrasim/scene/sensor_rules.h"

namespace infrasim {

namespace {

// Minimum number of rows that are kept: two for a frame, and one more for a clock offset.
constexpr std::size_t kFewestRows = 3;

}  // namespace

LazyTrajectories::LazyTrajectories(std::shared_ptr<const Site> site, double late_s,
                                   std::size_t most)
    : site_(std::move(site)),
      source_(*site_),
      late_s_(late_s),
      most_(most),
      frames_(frame_count(site_->scene.duration_s)) {
  restart();
}

std::vector<MovingObject> LazyTrajectories::in_frame(int k) {
  const std::lock_guard lock(mutex_);
  if (k < first_) {
    keeps_all_ = true;
    restart();
  }
  advance_to(k + 1);
  const auto at = static_cast<std::size_t>(k - first_);
  return objects_between(rows_[at], rows_[at + 1]);
}

void LazyTrajectories::drive() {
  const std::lock_guard lock(mutex_);
  advance_to(frames_);
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
  sink_ = [this](const std::vector<ObjectState>& states) { take(states); };
  if (late_s_ != 0) sink_ = resample_at_clock_offset(late_s_, frames_, sink_);
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
  const std::vector<ObjectState> states = steps_->next();
  check_sensor_is_free(site_->scene, states, instant_++);
  sink_(states);
}

void LazyTrajectories::take(const std::vector<ObjectState>& states) {
  rows_.push_back(states);
  states_ += states.size();
  while (!keeps_all_ && states_ > most_ && rows_.size() > kFewestRows) {
    states_ -= rows_.front().size();
    rows_.pop_front();
    ++first_;
  }
}

}  // namespace infrasim
