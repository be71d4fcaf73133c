#include "infrasim/scene/trajectories.h"

#include <algorithm>
#include <iterator>
#include <stdexcept>
#include <utility>

namespace infrasim {

namespace {

constexpr double kMetreDigits = 1e4;
constexpr double kRadianDigits = 1e6;

double round_to(double value, double digits) { return std::round(value * digits) / digits; }

}  // namespace

Box3d MovingObject::at(double u) const {
  Box3d box = from;
  box.x += u * (to.x - from.x);
  box.y += u * (to.y - from.y);
  box.z += u * (to.z - from.z);
  box.heading = wrap_angle(from.heading + u * wrap_angle(to.heading - from.heading));
  box.pitch += u * (to.pitch - from.pitch);
  return box;
}

std::vector<MovingObject> objects_between(const std::vector<ObjectState>& before,
                                          const std::vector<ObjectState>& after) {
  std::vector<MovingObject> objects;
  objects.reserve(std::min(before.size(), after.size()));
  auto to = after.begin();
  for (const ObjectState& from : before) {
    while (to != after.end() && to->id < from.id) ++to;
    if (to == after.end()) break;
    if (to->id == from.id)
      objects.push_back(
          {from.id, from.object_class, from.box, to->box, (from.speed_m_s + to->speed_m_s) / 2});
  }
  return objects;
}

double row_position(double time_s) {
  constexpr double kTolerance = 1e-6;
  const double position = time_s / kRowStep_s, row = std::round(position);
  return std::abs(position - row) <= kTolerance ? row : position;
}

std::pair<int, int> rows_around(double position, int steps) {
  const int before = std::clamp(static_cast<int>(std::floor(position)), 0, steps);
  if (before == position) return {before, before};
  const int first = std::min(before, steps - 1);
  return {first, first + 1};
}

std::vector<ObjectState> states_at(double position, int steps, const RowOf& row) {
  const auto [first, last] = rows_around(position, steps);
  if (first == last) return row(first);
  std::vector<ObjectState> states;
  for (const MovingObject& o : objects_between(row(first), row(last)))
    states.push_back(rounded({o.id, o.object_class, o.at(position - first), o.speed_m_s}));
  return states;
}

bool Trajectories::has(double position) const {
  const auto [first, last] = rows_around(position, steps());
  return kept.empty() ||
         (kept[static_cast<std::size_t>(first)] && kept[static_cast<std::size_t>(last)]);
}

std::vector<ObjectState> Trajectories::moving_at(double position) const {
  return states_at(position, steps(), [&](int k) -> const std::vector<ObjectState>& {
    const auto row = static_cast<std::size_t>(k);
    if (!kept.empty() && !kept[row])
      throw std::logic_error("row " + std::to_string(k) + " of the trajectories was not kept");
    return rows[row];
  });
}

std::vector<MovingObject> Trajectories::between(double from, double to) const {
  return with_standing(objects_between(moving_at(from), moving_at(to)), standing);
}

std::vector<MovingObject> with_standing(std::vector<MovingObject> moving,
                                        const std::vector<ObjectState>& standing) {
  if (standing.empty()) return moving;
  std::vector<MovingObject> objects;
  objects.reserve(moving.size() + standing.size());
  auto next = standing.begin();
  const auto add = [&](const ObjectState& s) {
    objects.push_back({s.id, s.object_class, s.box, s.box, s.speed_m_s});
  };
  for (const MovingObject& o : moving) {
    for (; next != standing.end() && next->id < o.id; ++next) add(*next);
    objects.push_back(o);
  }
  for (; next != standing.end(); ++next) add(*next);
  return objects;
}

std::vector<ObjectState> with_standing(const std::vector<ObjectState>& moving,
                                       const std::vector<ObjectState>& standing) {
  std::vector<ObjectState> states;
  states.reserve(moving.size() + standing.size());
  std::ranges::merge(moving, standing, std::back_inserter(states), {}, &ObjectState::id,
                     &ObjectState::id);
  return states;
}

TrajectoryKeeper::TrajectoryKeeper(std::vector<bool> asked, bool pitched, std::size_t most)
    : out_{{}, pitched, {}}, asked_(std::move(asked)), most_(most) {
  out_.rows.reserve(asked_.size());
}

void TrajectoryKeeper::take(const std::vector<ObjectState>& states) {
  const std::size_t k = out_.rows.size();
  const bool was_whole = states_ <= most_;
  states_ += states.size();
  if (states_ <= most_ || asked_[k])
    out_.rows.push_back(states);
  else
    out_.rows.emplace_back();
  if (!was_whole || states_ <= most_) return;
  for (std::size_t i = 0; i < k; ++i)
    if (!asked_[i]) std::vector<ObjectState>().swap(out_.rows[i]);
}

Trajectories TrajectoryKeeper::finish() {
  const std::size_t taken = out_.rows.size();
  if (taken < asked_.size() || states_ > most_) {
    out_.kept = std::move(asked_);
    out_.rows.resize(out_.kept.size());
    if (states_ <= most_) std::fill_n(out_.kept.begin(), taken, true);
    if (std::ranges::find(out_.kept, false) == out_.kept.end()) out_.kept.clear();
  }
  return std::move(out_);
}

ObjectState rounded(ObjectState state) {
  Box3d& b = state.box;
  for (double* v : {&b.x, &b.y, &b.z, &b.dx, &b.dy, &b.dz}) *v = round_to(*v, kMetreDigits);
  b.heading = round_to(wrap_angle(b.heading), kRadianDigits);
  b.pitch = round_to(b.pitch, kRadianDigits);
  state.speed_m_s = round_to(state.speed_m_s, kMetreDigits);
  return state;
}

}  // namespace infrasim
