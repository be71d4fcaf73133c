#pragma once

#include <span>
#include <vector>

#include "infrasim/config/scene_config.h"
#include "infrasim/core/rng.h"
#include "infrasim/scene/fleet.h"
#include "infrasim/scene/roads.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

inline constexpr int kFirstPersonId = 1'500'000'000;  ///< larger than the ids of parked vehicles
/// larger than the ids of walking pedestrians and cyclists
inline constexpr int kFirstStandingPersonId = 2'000'000'000;

/// The line of a row of pedestrians or cyclists, from one end to the other.
/// @param centreline of the road that the row names
/// @throws ConfigError for a row that begins beyond the road's end
Curve people_line(const Curve& centreline, const PeopleConfig& row);

/// Radius of the circle that contains the bodies of a standing group.
double radius_of(const StandingPeopleConfig& group);

/// The standing pedestrians of all groups, sampled from the scene's seed, on a level road.
/// @throws ConfigError for more people than a scene may have
std::vector<ObjectState> standing_people(const SceneConfig& scene);

/// A pedestrian or cyclist of a row, at all times.
struct Person {
  VehicleSize size;
  double start_m = 0;    ///< position at t = 0 in its direction of movement
  double speed_m_s = 0;  ///< constant
  bool back = false;     ///< moves against the direction of the line
  double aside_m = 0;    ///< to the left of the line while nobody is near
};

/// The pedestrians or cyclists of a row. They circulate on their line and on a stretch beyond both
/// of its ends, where they appear and disappear unseen. Those who meet or overtake someone step
/// aside without turning, and come back. Positions depend on the time alone.
class PeopleRow {
 public:
  /// @throws the exceptions of people_line
  PeopleRow(const Road& road, const PeopleConfig& row, const Rng& rng);

  std::size_t size() const { return people_.size(); }

  /// Appends those who are on the line at a time. Ids are first_id + lap * step + index in the row,
  /// so that each lap has new ids.
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
  double beyond_m_ = 0;  ///< length of the circulation before and after the line
  double circle_m_ = 0;
  std::vector<Person> people_;
};

/// All pedestrians and cyclists of a scene, sampled from its seed, in steady state from t = 0 on.
class People {
 public:
  /// @param centrelines of the scene's roads
  /// @throws ConfigError as people_line, for an unknown road, and for more people than a scene may
  ///   have
  People(const SceneConfig& scene, std::span<const Curve> centrelines);

  bool empty() const { return step_ == 0; }

  /// All states at a time, by increasing id from kFirstPersonId on. They depend on the time alone.
  std::vector<ObjectState> at(double time_s) const;

 private:
  std::vector<PeopleRow> rows_;
  int step_ = 0;  ///< number of people in all rows
};

}  // namespace infrasim
