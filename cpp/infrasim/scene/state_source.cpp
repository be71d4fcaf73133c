#include "infrasim/scene/state_source.h"

#include <utility>

#include "infrasim/core/errors.h"
#include "infrasim/scene/people.h"
#include "infrasim/scene/traffic.h"

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
                      std::to_string(scene.duration_s) + ", got " +
                      std::to_string(trajectories.frames() * kFramePeriod) + " s");
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

/// Passes on every instant together with the parked vehicles.
StateSink with_parked(const Site& site, const StateSink& sink) {
  std::vector<ObjectState> parked;
  for (const ParkedVehicle& vehicle : site.parked) parked.push_back(vehicle.state);
  if (parked.empty()) return sink;
  site.profile.lift(parked);
  return [parked = std::move(parked), sink](std::vector<ObjectState> states) {
    states.insert(states.end(), parked.begin(), parked.end());
    sink(states);
  };
}

/// Passes on every instant together with its pedestrians and cyclists.
StateSink with_people(const Site& site, const StateSink& sink) {
  People people(site.scene, site.centrelines);
  std::vector<ObjectState> standing = standing_people(site.scene);
  if (people.empty() && standing.empty()) return sink;
  return [people = std::move(people), standing = std::move(standing), &profile = site.profile, sink,
          instant = 0](std::vector<ObjectState> states) mutable {
    auto there = people.at(instant++ * kFramePeriod);
    there.insert(there.end(), standing.begin(), standing.end());
    profile.lift(there);
    states.insert(states.end(), there.begin(), there.end());
    sink(states);
  };
}

}  // namespace

StateSource::StateSource(const Site& site) : site_(site) {
  if (!site.scene.traffic) recorded_ = load_recorded(site.scene);
}

void StateSource::each(const StateSink& sink) const {
  each(sink, frame_count(site_.scene.duration_s) + 1);
}

void StateSource::each(const StateSink& sink, int instants) const {
  const StateSink all = with_parked(site_, with_people(site_, sink));
  if (site_.scene.traffic)
    return simulate_traffic(
        site_,
        [&](std::vector<ObjectState> states) {
          site_.profile.lift(states);
          all(states);
        },
        instants);
  for (int k = 0; k < instants; ++k) all(recorded_->rows[static_cast<std::size_t>(k)]);
}

}  // namespace infrasim
