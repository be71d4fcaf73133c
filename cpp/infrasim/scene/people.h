#pragma once

#include <span>
#include <vector>

#include "infrasim/config/scene_config.h"
#include "infrasim/core/rng.h"
#include "infrasim/scene/fleet.h"
#include "infrasim/scene/roads.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// smallest id of walking people, larger than the ids of parked vehicles
inline constexpr int kFirstPersonId = 1'500'000'000;
/// smallest id of standing people, larger than the ids of walking pedestrians and cyclists
inline constexpr int kFirstStandingPersonId = 2'000'000'000;

/// Returns the radius of the circle that contains the bodies of a standing group.
double radius_of(const StandingPeopleConfig& group);

/// Returns the standing pedestrians of all groups, sampled from the scene's seed. Their z
/// coordinates do not include the rise of the profile.
/// @throws ConfigError for more people than a scene may have
std::vector<ObjectState> standing_people(const SceneConfig& scene);

/// The properties of a pedestrian or cyclist of a row that are constant in time.
struct Person {
  VehicleSize size;
  double start_m = 0;  ///< position on the path at t = 0, in the person's direction of movement
  double speed_m_s = 0;
  bool back = false;   ///< whether the person moves against the direction of the line
  double aside_m = 0;  ///< offset to the left of the line while nobody is near
};

/// The pedestrians or cyclists of a row. They move along their line, which is extended at both
/// ends. A person who leaves one end of the extended line enters again at the other end. People on
/// the extensions are not objects of the scene. A person who meets or overtakes another one steps
/// aside without turning, and then returns to the line. All positions are functions of time only.
class PeopleRow {
 public:
  /// @throws ConfigError for a row that begins beyond the road's end
  PeopleRow(const Road& road, const PeopleConfig& row, const Rng& rng);

  std::size_t size() const { return people_.size(); }

  /// Appends the people who are on the line at a time. An id is first_id + lap * step + index in
  /// the row, so that each lap has new ids.
  void append_at(double time_s, int first_id, int step, std::vector<ObjectState>& out) const;

 private:
  struct Walk;
  struct Gap;
  std::vector<Walk> walks_at(double time_s) const;
  std::vector<Gap> gaps(const std::vector<Walk>& walks,
                        const std::vector<std::size_t>& place) const;
  double share(const Walk& walk) const;
  void make_way(std::vector<Walk>& walks) const;
  ObjectState state(const Walk& walk) const;

  const ObjectClass* object_class_;
  double elevation_m_;
  Curve line_;
  double beyond_m_ = 0;  ///< length of the extension at each end of the line
  double circle_m_ = 0;
  std::vector<Person> people_;
};

/// All walking pedestrians and moving cyclists of a scene, sampled from its seed. Their flow is in
/// steady state from t = 0 on.
class People {
 public:
  /// @param centrelines centrelines of the scene's roads
  /// @throws ConfigError for an unknown road, for a row beyond a road's end, and for more people
  ///   than a scene may have
  People(const SceneConfig& scene, std::span<const Curve> centrelines);

  bool empty() const { return step_ == 0; }

  /// Returns all states at a time, by increasing id from kFirstPersonId on. The states are
  /// functions of time only.
  std::vector<ObjectState> at(double time_s) const;

 private:
  std::vector<PeopleRow> rows_;
  int step_ = 0;  ///< number of people in all rows
};

}  // namespace infrasim
