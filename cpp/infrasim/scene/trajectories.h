#pragma once

#include <cmath>
#include <functional>
#include <utility>
#include <vector>

#include "infrasim/core/classes.h"
#include "infrasim/core/geometry.h"

namespace infrasim {

inline constexpr double kRowStep_s = 0.1;  ///< time step of the trajectory rows

/// Returns the number of time steps in a duration. The number of rows is larger by 1.
inline int row_steps(double duration_s) {
  return static_cast<int>(std::llround(duration_s / kRowStep_s));
}

/// Returns the number of whole frame periods in a duration.
inline int frame_count(double duration_s, double period_s) {
  constexpr double kTolerance = 1e-6;
  return static_cast<int>(row_steps(duration_s) * kRowStep_s / period_s + kTolerance);
}

/// Converts a time to a fractional row number: 2.5 is half way between rows 2 and 3. A number
/// within 1e-6 of a whole number is rounded.
double row_position(double time_s);

/// One object at one instant. The position is that of the box's centre in the world frame.
struct ObjectState {
  int id = 0;
  Class object_class = Class::kCar;
  Box3d box;
  double speed_m_s = 0;

  bool operator==(const ObjectState&) const = default;
};

/// One object during one frame. The position is linear in time, and the heading changes linearly in
/// the direction of the smaller rotation. Rays and labels both use this motion.
struct MovingObject {
  int id = 0;
  Class object_class = Class::kCar;
  Box3d from;
  Box3d to;
  double speed_m_s = 0;  ///< speed at the middle of the frame

  /// Returns the box at a share u of the frame, [0, 1].
  Box3d at(double u) const;
};

/// Returns the objects that exist at two instants, and therefore at the time between them.
std::vector<MovingObject> objects_between(const std::vector<ObjectState>& before,
                                          const std::vector<ObjectState>& after);

/// Function that returns the object states of row i.
using RowOf = std::function<const std::vector<ObjectState>&(int)>;
/// Returns the states at a fractional row number. Between two rows, the states are interpolated and
/// rounded. Only objects that exist in both rows are included. Before the first and after the last
/// row, objects continue with uniform motion.
/// @param steps number of row steps, at least 1
std::vector<ObjectState> states_at(double position, int steps, const RowOf& row);
/// Returns the first and the last row that `states_at` needs for a fractional row number.
std::pair<int, int> rows_around(double position, int steps);

/// All objects of a run: row k holds the states at 0.1 k seconds, by increasing id.
struct Trajectories {
  std::vector<std::vector<ObjectState>> rows;
  bool pitched =
      false;  ///< whether objects may have a pitch, so that tables have a column for the pitch
  /// whether each row is present; if the vector is empty, all rows are present
  std::vector<bool> kept;
  /// objects that stand during the whole run, by increasing id; `rows` does not contain these
  /// objects
  // NOLINTNEXTLINE(readability-redundant-member-init): GCC warns of initializers without it
  std::vector<ObjectState> standing = {};

  int steps() const { return static_cast<int>(rows.size()) - 1; }
  /// Returns whether the rows around a fractional row number are present.
  bool has(double position) const;
  /// Returns the states at a fractional row number, without the standing objects.
  /// @throws std::logic_error if a required row is missing
  std::vector<ObjectState> moving_at(double position) const;
  /// Returns the objects that exist from the fractional row number `from` to `to`, with the
  /// standing objects.
  /// @throws std::logic_error if one of the required rows is missing
  std::vector<MovingObject> between(double from, double to) const;
};

/// Adds standing objects to moving objects. The two inputs and the result are sorted by id.
std::vector<MovingObject> with_standing(std::vector<MovingObject> moving,
                                        const std::vector<ObjectState>& standing);
std::vector<ObjectState> with_standing(const std::vector<ObjectState>& moving,
                                       const std::vector<ObjectState>& standing);

/// Rounds a state to the digits of trajectories.csv, so that a run from that file equals the
/// original run.
ObjectState rounded(ObjectState state);

/// Function that receives the states of one instant, called for consecutive instants.
using StateSink = std::function<void(const std::vector<ObjectState>&)>;

/// Collects trajectories. All rows are kept up to a maximum number of states. Above this number,
/// only the requested rows are kept.
class TrajectoryKeeper {
 public:
  static constexpr std::size_t kMostStates = 1'000'000;  ///< maximum number of states, 80 MB

  /// @param asked whether each row is requested; one entry per row
  /// @param most  maximum number of states up to which all rows are kept
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

}  // namespace infrasim
