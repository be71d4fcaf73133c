#pragma once

#include <cmath>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "infrasim/core/classes.h"
#include "infrasim/core/geometry.h"

namespace infrasim {

inline constexpr double kFramePeriod = 0.1;  ///< seconds; also the time step of the trajectory rows

/// Number of frames in a duration.
inline int frame_count(double duration_s) {
  return static_cast<int>(std::llround(duration_s / kFramePeriod));
}

/// One object at one instant. The position is that of the box's centre in the world frame.
struct ObjectState {
  int id = 0;
  Class object_class = Class::kCar;
  Box3d box;
  double speed_m_s = 0;
};

/// One object during one frame. The position is linear in time, and the heading changes linearly
/// along the shorter way. Rays and labels both use this motion.
struct MovingObject {
  int id = 0;
  Class object_class = Class::kCar;
  Box3d from;
  Box3d to;
  double speed_m_s = 0;  ///< at the middle of the frame

  /// Returns the box at a share u of the frame, [0, 1].
  Box3d at(double u) const;
};

/// Returns the objects that exist at two consecutive instants, and therefore for the whole frame.
std::vector<MovingObject> objects_between(const std::vector<ObjectState>& before,
                                          const std::vector<ObjectState>& after);

/// All objects of a run: row k holds the states at 0.1 k seconds, by increasing id.
struct Trajectories {
  std::vector<std::vector<ObjectState>> rows;
  bool pitched =
      false;  ///< whether objects may have a pitch, so that their tables have a column for it
  std::vector<bool> kept;  ///< which rows are present; if empty, all rows are present

  int frames() const { return static_cast<int>(rows.size()) - 1; }
  bool whole() const { return kept.empty(); }
  /// Objects that exist for the whole of frame k.
  /// @throws std::logic_error if its rows are missing
  std::vector<MovingObject> in_frame(int k) const;
};

/// Rounds a state to the digits of the file, so that a run from the file equals the original run.
ObjectState rounded(ObjectState state);

/// Receives the states of consecutive instants.
using StateSink = std::function<void(const std::vector<ObjectState>&)>;

/// Collects trajectories. It keeps all rows as long as there are few states. If there are more, it
/// keeps only the requested rows.
class TrajectoryKeeper {
 public:
  static constexpr std::size_t kMostStates = 2'000'000;  ///< 160 MB

  /// @param asked whether each row is requested; one entry per row
  /// @param most  maximum number of states kept in rows that are not requested
  TrajectoryKeeper(std::vector<bool> asked, bool pitched, std::size_t most = kMostStates);

  void take(const std::vector<ObjectState>& states);
  /// Returns the kept trajectories. Rows that the keeper did not receive are missing.
  Trajectories finish();

 private:
  Trajectories out_;
  std::vector<bool> asked_;
  std::size_t most_;
  std::size_t states_ = 0;
};

/// Returns a sink that converts instants to a clock that is late by `late_s` (less than a frame),
/// and passes them to `sink`. Instant k of the late clock has the objects at 0.1 k + late_s,
/// interpolated as in a frame. Before the first and after the last instant, objects continue with
/// uniform motion. Objects that do not exist for the whole of a frame are omitted.
/// @param frames number of frames that will be passed on, one less than the number of instants
StateSink resample_at_clock_offset(double late_s, int frames, const StateSink& sink);
/// Like the function above, for trajectories. A row is kept if the two rows around it are present.
Trajectories resample_at_clock_offset(const Trajectories& trajectories, double late_s);

/// Makes the text of trajectories.csv, one instant after the other. The columns are
/// t,id,class,x,y,z,heading,dx,dy,dz,speed, and pitch if objects have a pitch. The units are metres
/// and radians, the frame is the world frame, and the rate is 10 Hz. If the first or the last
/// instant has no object, a row with only a time marks the begin or the end. A file without rows
/// describes a scene without objects.
class TrajectoryText {
 public:
  explicit TrajectoryText(bool pitched = false) : pitched_(pitched) {}

  /// The header line.
  std::string header() const;
  /// The rows of the next instant.
  std::string rows(const std::vector<ObjectState>& states);
  /// The text after the rows of the last instant.
  std::string end() const;

  int instants() const { return instants_; }

 private:
  std::string nobody_at(int instant) const;

  bool pitched_;
  int instants_ = 0;
  int first_ = -1;  ///< first instant with an object
  int last_ = -1;
};

/// The whole text of trajectories.csv.
std::string trajectories_csv(const Trajectories& trajectories);

/// @return the trajectories; they have no instants if the file has no rows
/// @throws ConfigError with file and line, for rows out of order, gaps, jumps or changing sizes
/// @throws IoError if the file can't be read
Trajectories read_trajectories(const std::filesystem::path& file);

}  // namespace infrasim
