#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "infrasim/core/classes.h"
#include "infrasim/core/geometry.h"

namespace infrasim {

inline constexpr double kFramePeriod = 0.1;  ///< s; also the step of the trajectory rows

/// One vehicle at one instant; world frame, box centre.
struct ObjectState {
  int id = 0;
  Class object_class = Class::kCar;
  Box3d box;
  double speed_m_s = 0;
};

/// One vehicle over one frame. Position is linear in time and heading goes the short way: the
/// rays and the labels use exactly this.
struct MovingObject {
  int id = 0;
  Class object_class = Class::kCar;
  Box3d from;
  Box3d to;
  double speed_m_s = 0;  ///< at the middle of the frame

  /// Box at u in [0, 1] of the frame.
  Box3d at(double u) const;
};

/// All vehicles of a run: row k holds the states at 0.1 k seconds, by increasing id.
struct Trajectories {
  std::vector<std::vector<ObjectState>> rows;
  bool pitched = false;  ///< vehicles may lean forwards or backwards: tables have the column

  int frames() const { return static_cast<int>(rows.size()) - 1; }
  /// Vehicles that are there for the whole of frame k.
  std::vector<MovingObject> in_frame(int k) const;
};

/// The same vehicles as a clock has them that runs `late_s` (within a frame) behind: row k holds
/// where they are at 0.1 k + late_s, between the rows as in a frame. Beyond the first and the last
/// row they go on as before; one that is not there for the whole of a frame leaves it out.
Trajectories seen_late(const Trajectories& trajectories, double late_s);

/// Rounds a state to the digits of the file, so that a run from the file equals the run itself.
ObjectState rounded(ObjectState state);

/// Takes the states of one instant after the other.
using TakeInstant = std::function<void(const std::vector<ObjectState>&)>;

/// The text of trajectories.csv, one instant after the other: columns
/// t,id,class,x,y,z,heading,dx,dy,dz,speed, and pitch where vehicles lean; metres, radians, world
/// frame, 10 Hz. Where nobody is at the first or the last instant, a row of its time alone says
/// that the file begins or ends there; a file without any row is of a scene without anybody.
class TrajectoryText {
 public:
  explicit TrajectoryText(bool pitched = false) : pitched_(pitched) {}

  /// The first line.
  std::string header() const;
  /// The rows of the next instant.
  std::string rows(const std::vector<ObjectState>& states);
  /// What follows the rows of the last instant.
  std::string end() const;

  int instants() const { return instants_; }

 private:
  std::string nobody_at(int instant) const;

  bool pitched_;
  int instants_ = 0;
  int first_ = -1;  ///< instant with somebody
  int last_ = -1;
};

/// The same as a whole.
std::string trajectories_csv(const Trajectories& trajectories);

/// @return without any instant for a file without rows
/// @throws ConfigError with file and line: rows out of order, gaps, jumps, sizes that change
/// @throws IoError if the file can't be read
Trajectories read_trajectories(const std::filesystem::path& file);

}  // namespace infrasim
