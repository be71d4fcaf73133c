#include "infrasim/scene/state_source.h"

#include "infrasim/config/fields.h"
#include "infrasim/core/errors.h"

namespace infrasim {

namespace {

Trajectories load_recorded(const SceneConfig& scene) {
  const std::filesystem::path file = scene.folder / scene.trajectories;
  if (!std::filesystem::exists(file))
    throw IoError(file.string() +
                  ": can't be read: not there; `pyinfra site traffic` or `pyinfra site "
                  "trajectories` writes the file of a site");
  Trajectories trajectories = read_trajectories(file);
  const int frames = frame_count(scene.duration_s);
  if (!trajectories.rows.empty() && trajectories.frames() < frames)
    throw ConfigError(file.string() + ": t: expected at least the scene's duration_s of " +
                      config::number_text(scene.duration_s) + ", got " +
                      config::number_text(trajectories.frames() / 10.0) + " s");
  trajectories.rows.resize(static_cast<std::size_t>(frames) + 1);
  const bool people = scene.people || scene.standing_people;
  if (!scene.parked && !people) return trajectories;
  const int first = scene.parked ? kFirstParkedId : kFirstPersonId;
  for (const auto& states : trajectories.rows)
    if (!states.empty() && states.back().id >= first)
      throw ConfigError(file.string() + ": id: expected below " + std::to_string(first) +
                        ", where those of " + (scene.parked ? "parked vehicles" : "people") +
                        " begin, got " + std::to_string(states.back().id));
  return trajectories;
}

}  // namespace

StateSource::StateSource(const Site& site) : site_(site) {
  if (!site.scene.traffic) recorded_ = load_recorded(site.scene);
}

void StateSource::each(const StateSink& sink) const {
  each(sink, frame_count(site_.scene.duration_s) + 1);
}

void StateSource::each(const StateSink& sink, int instants) const {
  StateSteps steps(*this);
  for (int k = 0; k < instants; ++k) sink(steps.next());
}

StateSteps::StateSteps(const StateSource& source)
    : source_(source),
      people_(source.site_.scene, source.site_.centrelines),
      standing_people_(standing_people(source.site_.scene)) {
  const Site& site = source.site_;
  for (const ParkedVehicle& vehicle : site.parked) parked_.push_back(vehicle.state);
  site.profile.lift(parked_);
  site.profile.lift(standing_people_);
  if (site.scene.traffic) traffic_.emplace(site);
}

std::vector<ObjectState> StateSteps::next() {
  const Profile& profile = source_.site_.profile;
  std::vector<ObjectState> states;
  if (traffic_) {
    states = traffic_->next();
    profile.lift(states);
  } else {
    states = source_.recorded_->rows[static_cast<std::size_t>(instant_)];
  }
  std::vector<ObjectState> people = people_.at(instant_ * kFramePeriod);
  profile.lift(people);
  for (const auto* more : {&parked_, &people, &standing_people_})
    states.insert(states.end(), more->begin(), more->end());
  ++instant_;
  return states;
}

}  // namespace infrasim
