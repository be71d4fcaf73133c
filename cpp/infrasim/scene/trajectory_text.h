#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "infrasim/io/csv.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// Function that receives the number and the states of a row.
using RowSink = std::function<void(int, const std::vector<ObjectState>&)>;
/// Function that passes all rows to a sink, with ascending numbers. The function may be called
/// several times.
using RowSource = std::function<void(const RowSink&)>;

/// Makes the text of trajectories.csv and passes it on in pieces of whole lines. The columns are
/// t,id,class,x,y,z,heading,dx,dy,dz,speed, and pitch if objects have a pitch. The units are metres
/// and radians, the frame is the world frame, and times are multiples of 0.1 s. The text has only
/// the first and the last of consecutive equal states of an object. If the first or the last row
/// has no object, the text has a line with only the time of this row. A file without rows describes
/// a scene without objects.
/// @param source source of the rows, called twice
void write_trajectories(bool pitched, const RowSource& source,
                        const std::function<void(std::string_view)>& take);

/// Returns the whole text of trajectories.csv.
std::string trajectories_csv(const Trajectories& trajectories);

/// One line of trajectories.csv.
struct TrajectoryLine {
  int step = 0;                      ///< number of the row
  std::optional<ObjectState> state;  ///< no value in a line with only a time
};

/// Reads the lines of trajectories.csv one by one.
class TrajectoryLines {
 public:
  /// @throws ConfigError if the first line is not the header, IoError if the file can't be read
  explicit TrajectoryLines(const std::filesystem::path& file);

  bool pitched() const { return csv_.has_last(); }
  /// Returns the next line; no value after the last line.
  /// @throws ConfigError with file and line, for a wrong value or lines out of order
  std::optional<TrajectoryLine> next();
  /// Throws an error about the line that was read last.
  [[noreturn]] void fail(std::string_view key, const std::string& what) const {
    csv_.fail_row(key, what);
  }

 private:
  CsvReader csv_;
  TrajectoryLine last_;
  bool begun_ = false;
};

/// Reads all rows of trajectories.csv. An object may be missing only in rows between two equal
/// states. The reader adds the same state to these rows.
/// @return the trajectories; they have no instants if the file has no rows
/// @throws ConfigError with file and line, for lines out of order, gaps, jumps or changing sizes
/// @throws IoError if the file can't be read
Trajectories read_trajectories(const std::filesystem::path& file);

}  // namespace infrasim
