#include "infrasim/scene/state_source.h"

#include <algorithm>

#include "infrasim/config/fields.h"
#include "infrasim/core/errors.h"

namespace infrasim {

namespace {

Trajectories load_recorded(const SceneConfig& scene) {
  const std::filesystem::path file = scene.folder / scene.trajectories;
  Trajectories trajectories = config::read_named(scene.trajectories_key, [&] {
    if (!std::filesystem::exists(file))
      throw IoError(
          file.string() +
          ": can't be read: the file does not exist; `pyinfra site traffic` or `pyinfra site "
          "trajectories` writes the file of a site");
    return read_trajectories(file);
  });
  const int steps = row_steps(scene.duration_s);
  if (!trajectories.rows.empty() && trajectories.steps() < steps)
    throw ConfigError(file.string() + ": t: expected times up to the scene's duration_s of " +
                      config::number_text(scene.duration_s) + " s, got times up to " +
                      config::number_text(trajectories.steps() / 10.0) + " s");
  trajectories.rows.resize(static_cast<std::size_t>(steps) + 1);
  const bool people = scene.people || scene.standing_people;
  if (!scene.parked && !people) return trajectories;
  const int first = scene.parked ? kFirstParkedId : kFirstPersonId;
  for (const auto& states : trajectories.rows)
    if (!states.empty() && states.back().id >= first)
      throw ConfigError(file.string() + ": id: expected ids below " + std::to_string(first) +
                        ", where the ids of " + (scene.parked ? "parked vehicles" : "people") +
                        " begin, got " + std::to_string(states.back().id));
  return trajectories;
}

/// Removes the objects that have the same state in all rows, and returns these states.
std::vector<ObjectState> take_standing(std::vector<std::vector<ObjectState>>& rows) {
  std::vector<ObjectState> standing = rows.front();
  const auto has = [](const std::vector<ObjectState>& states, const ObjectState& s) {
    const auto same_id = std::ranges::lower_bound(states, s.id, {}, &ObjectState::id);
    return same_id != states.end() && *same_id == s;
  };
  for (const auto& states : rows)
    std::erase_if(standing, [&](const ObjectState& s) { return !has(states, s); });
  for (auto& states : rows) {
    std::erase_if(states, [&](const ObjectState& s) { return has(standing, s); });
    states.shrink_to_fit();
  }
  return standing;
}

}  // namespace

StateSource::StateSource(const Site& site) : site_(site) {
  if (!site.scene.traffic) {
    recorded_ = load_recorded(site.scene);
    standing_ = take_standing(recorded_->rows);
  }
  std::vector<ObjectState> parked;
  for (const ParkedVehicle& vehicle : site.parked) parked.push_back(vehicle.state);
  std::vector<ObjectState> people = standing_people(site.scene);
  for (std::vector<ObjectState>* more : {&parked, &people}) {
    site.profile.lift(*more);
    standing_.insert(standing_.end(), more->begin(), more->end());
  }
}

void StateSource::each(const StateSink& sink) const {
  StateSteps steps(*this);
  for (int k = 0; k <= row_steps(site_.scene.duration_s); ++k)
    sink(with_standing(steps.next_moving(), standing_));
}

StateSteps::StateSteps(const StateSource& source)
    : source_(source), people_(source.site_.scene, source.site_.centrelines) {
  if (source.site_.scene.traffic) traffic_.emplace(source.site_);
}

std::vector<ObjectState> StateSteps::next_moving() {
  const Profile& profile = source_.site_.profile;
  std::vector<ObjectState> states;
  if (traffic_) {
    states = traffic_->next();
    profile.lift(states);
  } else {
    states = source_.recorded_->rows[static_cast<std::size_t>(instant_)];
  }
  std::vector<ObjectState> people = people_.at(instant_ * kRowStep_s);
  profile.lift(people);
  states.insert(states.end(), people.begin(), people.end());
  ++instant_;
  return states;
}

}  // namespace infrasim
