#include "infrasim/pipeline/trajectory_file.h"

#include <algorithm>
#include <fstream>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>

#include "infrasim/config/fields.h"
#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/io/atomic_file.h"
#include "infrasim/io/data_set.h"

namespace infrasim {

namespace {

/// Reads the rows of a trajectories.csv one after the other, each with its object states.
class StoredRows {
 public:
  explicit StoredRows(const std::filesystem::path& file) : lines_(file), line_(lines_.next()) {}

  bool pitched() const { return lines_.pitched(); }
  /// Returns the number of the next row; no value after the last row.
  std::optional<int> step() const { return line_ ? std::optional(line_->step) : std::nullopt; }
  /// Returns the states of the next row and goes on to the row after it.
  std::vector<ObjectState> take() {
    std::vector<ObjectState> states;
    for (const int step = line_->step; line_ && line_->step == step; line_ = lines_.next())
      if (line_->state) states.push_back(*line_->state);
    return states;
  }

 private:
  TrajectoryLines lines_;
  std::optional<TrajectoryLine> line_;
};

std::string text_of(double value) { return config::number_text(value); }

std::string place_of(const ObjectState& s) {
  return "x " + text_of(s.box.x) + ", y " + text_of(s.box.y);
}

const ObjectState* find_state(const std::vector<ObjectState>& states, int id) {
  const auto state = std::ranges::lower_bound(states, id, {}, &ObjectState::id);
  return state != states.end() && state->id == id ? &*state : nullptr;
}

/// Compares the rows of an existing file with those of a world. A file may omit a state between two
/// equal states of the object. Any other difference in a row that both have is an error.
class RowComparison {
 public:
  explicit RowComparison(const std::filesystem::path& file) : file_(file) {}

  /// Processes the states that a row of the file contains. States that the file omits are not among
  /// them.
  void take_stored(const std::vector<ObjectState>& stored) {
    for (const ObjectState& s : stored) {
      Stored& last = last_.try_emplace(s.id, Stored{s, {}}).first->second;
      if (last.omitted_at && last.state != s) fail_without(*last.omitted_at, last.state);
      last = {s, {}};
    }
  }
  /// Compares a row that both the file and the world have.
  void compare(int k, const std::vector<ObjectState>& stored,
               const std::vector<ObjectState>& of_run) {
    for (const ObjectState& s : stored) {
      const ObjectState* state = find_state(of_run, s.id);
      if (state != nullptr && *state == s) continue;
      fail(k, "it has object " + std::to_string(s.id) + " at " + place_of(s) + ", this run has " +
                  (state != nullptr ? "it at " + place_of(*state) : "no such object"));
    }
    for (const ObjectState& s : of_run) {
      if (find_state(stored, s.id) != nullptr) continue;
      const auto last = last_.find(s.id);
      if (last == last_.end() || last->second.state != s) fail_without(k, s);
      if (!last->second.omitted_at) last->second.omitted_at = k;
    }
    take_stored(stored);
  }
  /// Checks, after the last row, that an equal state follows each omitted state.
  void finish() const {
    for (const auto& [id, last] : last_)
      if (last.omitted_at) fail_without(*last.omitted_at, last.state);
  }
  [[noreturn]] void fail(int k, const std::string& what) const {
    throw IoError(file_.string() + ": the folder holds another run: at " + text_of(k / 10.0) +
                  " s " + what + "; use another folder");
  }

 private:
  struct Stored {
    ObjectState state;  ///< last state in the file
    /// first row after `state` in which the file omits an equal state
    std::optional<int> omitted_at;
  };
  [[noreturn]] void fail_without(int k, const ObjectState& s) const {
    fail(k, "it has no object " + std::to_string(s.id) + " at " + place_of(s) +
                ", where this run has one");
  }

  const std::filesystem::path& file_;
  std::unordered_map<int, Stored> last_;
};

/// The union of the trajectory rows of a world and of an existing file.
class UnionOfRows {
 public:
  /// @param existing file with further rows; empty if there is none
  UnionOfRows(const World& world, const std::vector<bool>& rows, std::filesystem::path existing)
      : world_(world), rows_(rows), existing_(std::move(existing)) {}

  /// @throws IoError if a row that both have contains other objects in the file than in the world.
  ///   For a scene with recorded trajectories, the file must have all rows.
  void check() const {
    if (existing_.empty()) return;
    const bool whole = !world_.scene.traffic;
    StoredRows stored(existing_);
    RowComparison rows(existing_);
    for (int k = 0; k < static_cast<int>(rows_.size()); ++k) {
      while (stored.step() && *stored.step() < k) rows.take_stored(stored.take());
      if (!has(k)) continue;
      const bool in_file = stored.step() == k;
      if (!in_file && !whole) continue;
      rows.compare(k, in_file ? stored.take() : std::vector<ObjectState>{},
                   with_standing(moving_at(k), world_.trajectories->standing));
    }
    while (stored.step()) {
      const int step = *stored.step();
      if (whole) rows.fail(step, "the file has a row, this run has none");
      rows.take_stored(stored.take());
    }
    rows.finish();
  }

  void each(const RowSink& sink) const {
    std::optional<StoredRows> stored;
    if (!existing_.empty()) stored.emplace(existing_);
    for (int k = 0; k < static_cast<int>(rows_.size()); ++k) {
      while (stored && stored->step() && *stored->step() < k) {
        const int step = *stored->step();
        sink(step, stored->take());
      }
      if (!has(k)) continue;
      if (stored && stored->step() == k) stored->take();
      // Standing objects are needed only in the first and the last of consecutive rows.
      const std::vector<ObjectState> moving = moving_at(k);
      sink(k, has(k - 1) && has(k + 1) ? moving
                                       : with_standing(moving, world_.trajectories->standing));
    }
    while (stored && stored->step()) {
      const int step = *stored->step();
      sink(step, stored->take());
    }
  }

 private:
  bool has(int k) const {
    return k >= 0 && k < static_cast<int>(rows_.size()) && rows_[static_cast<std::size_t>(k)];
  }

  std::vector<ObjectState> moving_at(int k) const {
    return world_.trajectories->moving_at(world_.position(k * kRowStep_s));
  }

  const World& world_;
  const std::vector<bool>& rows_;
  const std::filesystem::path existing_;
};

/// Returns whether the file has exactly the text that `give` passes on in pieces.
bool has_text(const std::filesystem::path& file,
              const std::function<void(const std::function<void(std::string_view)>&)>& give) {
  std::ifstream there = open_file(file);
  bool same = true;
  std::string read;
  give([&](std::string_view piece) {
    if (!same) return;
    read.resize(piece.size());
    there.read(read.data(), static_cast<std::streamsize>(read.size()));
    same = there.gcount() == static_cast<std::streamsize>(piece.size()) && read == piece;
  });
  return same && there.peek() == std::ifstream::traits_type::eof();
}

constexpr std::size_t kPiece = 1 << 20;  // approximate number of bytes per write

void merge_rows(const std::filesystem::path& file, const World& world,
                const std::vector<bool>& rows) {
  if (was_read(file))
    throw IoError(file.string() + ": expected an output that the run does not read, got an input");
  const FolderLock lock(file.parent_path());
  const bool exists = std::filesystem::exists(file);
  const bool pitched = world.trajectories->pitched;
  if (exists && StoredRows(file).pitched() != pitched)
    throw IoError(file.string() + ":1: the folder holds another run: expected the column pitch " +
                  (pitched ? "in both runs" : "in no run") + ", got it in one; use another folder");
  const UnionOfRows all(world, rows, exists ? file : "");
  all.check();
  const RowSource source = [&](const RowSink& sink) { all.each(sink); };
  const auto give = [&](const std::function<void(std::string_view)>& take) {
    write_trajectories(pitched, source, take);
  };
  if (exists && has_text(file, give)) return;
  AtomicFile out(file);
  std::string text;
  give([&](std::string_view piece) {
    text += piece;
    if (text.size() >= kPiece) out.write(std::exchange(text, ""));
  });
  out.write(text);
  out.replace();
}

}  // namespace

std::vector<bool> rows_of_run(const SceneConfig& scene, std::span<const int> frames,
                              double period_s) {
  const int steps = row_steps(scene.duration_s);
  return scene.traffic ? rows_of_frames(frames, period_s, steps)
                       : std::vector<bool>(static_cast<std::size_t>(steps) + 1, true);
}

void merge_trajectories(const std::filesystem::path& file, const World& world,
                        const std::vector<bool>& rows) {
  try {
    merge_rows(file, world, rows);
  } catch (const ConfigError& error) {
    // The file is an output. An error in it is no error in the user's configuration.
    throw IoError(error.what());
  }
}

}  // namespace infrasim
