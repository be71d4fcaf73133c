#pragma once

#include <cmath>
#include <functional>
#include <utility>
#include <vector>

#include "infrasim/core/classes.h"
#include "infrasim/core/geometry.h"

namespace infrasim {

inline constexpr double kRowStep_s = 0.1;  ///< time step of the trajectory rows

/// Number of row steps in a duration. There is one row more.
inline int row_steps(double duration_s) {
  return static_cast<int>(std::llround(duration_s / kRowStep_s));
}

/// Number of whole frames of a period in a duration.
inline int frame_count(double duration_s, double period_s) {
  constexpr double kTolerance = 1e-6;
  return static_cast<int>(row_steps(duration_s) * kRowStep_s / period_s + kTolerance);
}

/// Returns a time as a position in the rows: 2 is row 2, and 2.5 is between rows 2 and 3. A
/// position within 1e-6 of a row is that row.
double row_position(double time_s);

/// One object at one instant. The position is that of the box's centre in the world frame.
struct ObjectState {
  int id = 0;
  Class object_class = Class::kCar;
  Box3d box;
  double speed_m_s = 0;

  bool operator==(const ObjectState&) const = default;
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

/// Returns the objects that exist at two instants, and therefore at the time between them.
std::vector<MovingObject> objects_between(const std::vector<ObjectState>& before,
                                          const std::vector<ObjectState>& after);

/// Returns row i of a table of instants.
using RowOf = std::function<const std::vector<ObjectState>&(int)>;
/// Returns the states at a position in the rows. They are those of a row, or they are interpolated
/// in the two rows around the position and rounded. Objects must exist in both rows. Before the
/// first and after the last row, objects continue with uniform motion.
/// @param steps number of row steps, at least 1
std::vector<ObjectState> states_at(double position, int steps, const RowOf& row);
/// Returns the first and the last row that `states_at` needs for a position.
std::pair<int, int> rows_around(double position, int steps);

/// All objects of a run: row k holds the states at 0.1 k seconds, by increasing id.
struct Trajectories {
  std::vector<std::vector<ObjectState>> rows;
  bool pitched =
      false;  ///< whether objects may have a pitch, so that their tables have a column for it
  std::vector<bool> kept;  ///< which rows are present; if empty, all rows are present
  /// objects that stand during the whole run, by increasing id; `rows` does not have them
  // NOLINTNEXTLINE(readability-redundant-member-init): GCC warns of initializers without it
  std::vector<ObjectState> standing = {};

  int steps() const { return static_cast<int>(rows.size()) - 1; }
  bool whole() const { return kept.empty(); }
  /// Returns whether the rows that a position needs are present.
  bool has(double position) const;
  /// States at a position in the rows, without the standing objects.
  /// @throws std::logic_error if its rows are missing
  std::vector<ObjectState> moving_at(double position) const;
  /// Objects that exist from one position in the rows to another, with the standing objects.
  /// @throws std::logic_error if rows are missing
  std::vector<MovingObject> between(double from, double to) const;
  /// Objects that exist from row k to row k + 1.
  std::vector<MovingObject> in_step(int k) const { return between(k, k + 1); }
};

/// Adds objects that stand to objects that move. Both are sorted by id, as is the result.
std::vector<MovingObject> with_standing(std::vector<MovingObject> moving,
                                        const std::vector<ObjectState>& standing);
std::vector<ObjectState> with_standing(const std::vector<ObjectState>& moving,
                                       const std::vector<ObjectState>& standing);

/// Rounds a state to the digits of the file, so that a run from the file equals the original run.
ObjectState rounded(ObjectState state);

/// Receives the states of consecutive instants.
using StateSink = std::function<void(const std::vector<ObjectState>&)>;

/// Collects trajectories. It keeps all rows as long as there are few states. If there are more, it
/// keeps only the requested rows.
class TrajectoryKeeper {
 public:
  static constexpr std::size_t kMostStates = 1'000'000;  ///< 80 MB

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

}  // namespace infrasim
