#pragma once

#include <cmath>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "infrasim/core/classes.h"
#include "infrasim/core/geometry.h"

namespace infrasim {

inline constexpr double kFramePeriod = 0.1;  ///< s; also the step of the trajectory rows

/// Frames of a scene of such a duration.
inline int frame_count(double duration_s) {
  return static_cast<int>(std::llround(duration_s / kFramePeriod));
}

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
  bool pitched = false;    ///< vehicles may lean forwards or backwards: tables have the column
  std::vector<bool> kept;  ///< which rows are here, the others being empty; none: all are

  int frames() const { return static_cast<int>(rows.size()) - 1; }
  bool whole() const { return kept.empty(); }
  /// Vehicles that are there for the whole of frame k.
  /// @throws std::logic_error if its rows are not here
  std::vector<MovingObject> in_frame(int k) const;
};

/// Rounds a state to the digits of the file, so that a run from the file equals the run itself.
ObjectState rounded(ObjectState state);

/// Takes the states of one instant after the other.
using StateSink = std::function<void(const std::vector<ObjectState>&)>;

/// Keeps trajectories as they are handed over: all rows while they are few, then only those that
/// are asked for.
class TrajectoryKeeper {
 public:
  static constexpr std::size_t kMostStates = 2'000'000;  ///< 160 MB

  /// @param asked of each row, whether it is; as many as there will be
  /// @param most  states that are kept of rows that nobody asks for
  TrajectoryKeeper(std::vector<bool> asked, bool pitched, std::size_t most = kMostStates);

  void take(const std::vector<ObjectState>& states);
  /// Rows that were not handed over are not kept.
  Trajectories finish();

 private:
  Trajectories out_;
  std::vector<bool> asked_;
  std::size_t most_;
  std::size_t states_ = 0;
};

/// Hands the instants on as a clock has them that runs `late_s` (within a frame) behind: instant k
/// is where all are at 0.1 k + late_s, between two instants as in a frame. Before the first and
/// after the last one they go on as before; who is not there for the whole of a frame is left out.
/// @param frames that will be handed over, one less than instants
StateSink resample_at_clock_offset(double late_s, int frames, const StateSink& sink);
/// The same of trajectories, of which a row is kept if those it lies between are.
Trajectories resample_at_clock_offset(const Trajectories& trajectories, double late_s);

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
