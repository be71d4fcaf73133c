#pragma once

#include <span>
#include <vector>

#include "infrasim/config/scene_config.h"
#include "infrasim/core/rng.h"
#include "infrasim/scene/fleet.h"
#include "infrasim/scene/roads.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

inline constexpr int kFirstPersonId = 1'500'000'000;          ///< beyond those of parked vehicles
inline constexpr int kFirstStandingPersonId = 2'000'000'000;  ///< beyond those of people who walk

/// The line of a row of people, from one end to the other.
/// @param centreline of the road that the row names
/// @throws ConfigError for a row that begins beyond the road's end
Curve people_line(const Curve& centreline, const PeopleConfig& row);

/// The radius of the circle that the people of a group stand in, their bodies included.
double radius_of(const StandingPeopleConfig& group);

/// The people of all groups who stand, drawn from the scene's seed, on a level road.
/// @throws ConfigError for more people than a scene may have
std::vector<ObjectState> standing_people(const SceneConfig& scene);

/// Somebody of a row, without beginning or end.
struct Person {
  VehicleSize size;
  double start_m = 0;    ///< at t = 0, along the way it goes
  double speed_m_s = 0;  ///< constant
  bool back = false;     ///< goes against the line
  double aside_m = 0;    ///< to the left of the line while nobody is near
};

/// People of a row: they circulate on their line and beyond both of its ends, where nobody sees
/// them come and go. Who meets or overtakes another steps aside, without turning, and comes back; a
/// place is a function of the time alone.
class PeopleRow {
 public:
  /// @throws ConfigError as people_line
  PeopleRow(const Road& road, const PeopleConfig& row, const Rng& rng);

  std::size_t size() const { return people_.size(); }

  /// Those on the line at a time; ids are first_id + lap * step + number in the row, so that who
  /// comes again is another one.
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
  double beyond_m_ = 0;  ///< circulated before and after the line
  double circle_m_ = 0;
  std::vector<Person> people_;
};

/// All people of a scene, drawn from its seed, in steady state from t = 0 on.
class People {
 public:
  /// @param centrelines of the scene's roads
  /// @throws ConfigError as people_line, for an unknown road, and for more people than a scene may
  /// have
  People(const SceneConfig& scene, std::span<const Curve> centrelines);

  bool empty() const { return step_ == 0; }

  /// By increasing id, all from kFirstPersonId on; a function of the time alone.
  std::vector<ObjectState> at(double time_s) const;

 private:
  std::vector<PeopleRow> rows_;
  int step_ = 0;  ///< people of all rows
};

}  // namespace infrasim
