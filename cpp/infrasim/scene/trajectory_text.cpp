#include "infrasim/scene/trajectory_text.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <unordered_map>
#include <utility>

#include "infrasim/config/fields.h"

namespace infrasim {

namespace {

constexpr char kHeader[] = "t,id,class,x,y,z,heading,dx,dy,dz,speed";
constexpr char kPitchColumn[] = "pitch";
constexpr int kColumns = 11;  // number of columns without pitch
constexpr double kMostPitch = kPi / 6;
constexpr double kMaxStep = 10;       // m, maximum movement in 0.1 s; 360 km/h
constexpr double kMaxTurn = kPi / 3;  // rad, maximum turn in 0.1 s

/// Makes lines of trajectories.csv.
class LineText {
 public:
  explicit LineText(bool pitched) : pitched_(pitched) {}

  std::string header() const {
    return std::string(kHeader) + (pitched_ ? std::string(",") + kPitchColumn : "") + "\n";
  }
  /// Returns the line of an instant without objects.
  std::string nobody(int row) const {
    return config::number_text(time_s(row)) + std::string(pitched_ ? kColumns : kColumns - 1, ',') +
           "\n";
  }
  void add(int row, const ObjectState& s, std::string& text) const {
    std::array<char, 32> buffer{};
    const auto append = [&](auto value, char end) {
      text.append(buffer.data(),
                  std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr);
      text += end;
    };
    append(time_s(row), ',');
    append(s.id, ',');
    text += class_of(s.object_class).name;
    text += ',';
    for (const double v : {s.box.x, s.box.y, s.box.z, s.box.heading, s.box.dx, s.box.dy, s.box.dz})
      append(v, ',');
    append(s.speed_m_s, pitched_ ? ',' : '\n');
    if (pitched_) append(s.box.pitch, '\n');
  }

 private:
  static double time_s(int row) { return std::round(row * kRowStep_s * 10) / 10; }

  bool pitched_;
};

/// Finds the states that trajectories.csv must contain: the first and the last of consecutive equal
/// states of an object.
class EndsOfRuns {
 public:
  /// Adds the next row in the first pass.
  void take(int row, const std::vector<ObjectState>& states) {
    for (const ObjectState& s : states) {
      auto& [run, ends, next] =
          objects_.try_emplace(s.id, Object{{s, row, row}, {}, 0}).first->second;
      if (run.state != s) {
        if (run.last > run.first) ends.push_back(run.last);
        run = {s, row, row};
      }
      run.last = row;
    }
  }
  void finish() {
    for (auto& [id, object] : objects_) {
      auto& [run, ends, next] = object;
      if (run.last > run.first) ends.push_back(run.last);
      run.first = -1;  // marks the beginning of the second pass
    }
  }
  /// Returns, in the second pass, whether the text must contain this state.
  bool has(int row, const ObjectState& s) {
    auto& [run, ends, next] = objects_.at(s.id);
    if (run.first < 0 || run.state != s) {
      run = {s, row, row};
      return true;
    }
    if (next == ends.size() || ends[next] != row) return false;
    ++next;
    return true;
  }

 private:
  struct Run {
    ObjectState state;
    int first, last;  ///< numbers of the first and last row
  };
  struct Object {
    Run run;
    std::vector<int> ends;  ///< last row of each run of several rows
    std::size_t next;       ///< index in `ends` during the second pass
  };
  std::unordered_map<int, Object> objects_;
};

}  // namespace

void write_trajectories(bool pitched, const RowSource& source,
                        const std::function<void(std::string_view)>& take) {
  EndsOfRuns ends;
  int first = -1, last = -1;
  source([&](int row, const auto& states) {
    if (first < 0) first = row;
    last = row;
    ends.take(row, states);
  });
  ends.finish();
  const LineText lines(pitched);
  std::string text = lines.header();
  bool objects = false, ended = false;
  std::string begin;  // text of an empty first row, written only if an object follows
  source([&](int row, const auto& states) {
    if (states.empty() && row == first) begin = lines.nobody(row);
    if (!states.empty()) {
      text += std::exchange(begin, "");
      objects = true;
    }
    for (const ObjectState& s : states)
      if (ends.has(row, s)) lines.add(row, s, text);
    ended = row == last && states.empty();
    take(std::exchange(text, ""));
  });
  if (!text.empty()) take(text);
  if (objects && ended) take(lines.nobody(last));
}

std::string trajectories_csv(const Trajectories& trajectories) {
  std::string text;
  write_trajectories(
      trajectories.pitched,
      [&](const RowSink& sink) {
        for (int k = 0; k <= trajectories.steps(); ++k)
          sink(k, with_standing(trajectories.moving_at(k), trajectories.standing));
      },
      [&](std::string_view piece) { text += piece; });
  return text;
}

TrajectoryLines::TrajectoryLines(const std::filesystem::path& file)
    : csv_(file, kHeader, kPitchColumn) {}

std::optional<TrajectoryLine> TrajectoryLines::next() {
  constexpr double kNobody = -1;  // value in place of the blank id of a line with only a time
  if (!csv_.next_row()) return std::nullopt;
  const double t = csv_.number("t", 0, 1e5);
  TrajectoryLine line{static_cast<int>(std::llround(t / kRowStep_s)), std::nullopt};
  if (const double id = csv_.number_or(kNobody, "id", 0, 2147483647); id == kNobody) {
    for (int i = 2; i < kColumns + (pitched() ? 1 : 0); ++i)
      if (!csv_.cell().empty())
        csv_.fail("id", "expected a number, got an empty cell in a row that has more than a time");
  } else {
    if (id != std::floor(id))
      csv_.fail("id", "expected a whole number, got '" + config::number_text(id) + "'");
    ObjectState& s = line.state.emplace();
    s.id = static_cast<int>(id);
    const std::string_view class_name = csv_.cell();
    const ObjectClass* class_entry = find_class(class_name);
    if (class_entry == nullptr)
      csv_.fail("class", "expected Car, Van, Truck, Bus, Motorcycle, Pedestrian, Cyclist, got '" +
                             std::string(class_name.substr(0, 40)) + "'");
    s.object_class = class_entry->id;
    s.box.x = csv_.number("x", -1e7, 1e7);
    s.box.y = csv_.number("y", -1e7, 1e7);
    s.box.z = csv_.number("z", -1e4, 1e5);
    s.box.heading = csv_.number("heading", -2 * kPi, 2 * kPi);
    s.box.dx = csv_.number("dx", 0.1, 50);
    s.box.dy = csv_.number("dy", 0.1, 50);
    s.box.dz = csv_.number("dz", 0.1, 50);
    s.speed_m_s = csv_.number("speed", -100, 200);
    if (pitched()) s.box.pitch = csv_.number(kPitchColumn, -kMostPitch, kMostPitch);
  }
  if (std::abs(t - line.step * kRowStep_s) > 1e-6)
    fail("t", "expected a multiple of 0.1 s, got another time");
  if (begun_ && line.step < last_.step)
    fail("t", "expected ascending times, got a time before that of the row above");
  if (begun_ && line.step == last_.step && line.state && last_.state &&
      last_.state->id >= line.state->id)
    fail("id", "expected ascending ids within an instant, got ids in another order");
  begun_ = true;
  last_ = line;
  return line;
}

namespace {

/// Reads a trajectory file row by row and reports errors with their position.
class TrajectoryReader {
 public:
  explicit TrajectoryReader(const std::filesystem::path& file) : lines_(file) {}

  Trajectories read() {
    out_.pitched = lines_.pitched();
    while (const auto line = lines_.next()) {
      go_to(line->step);
      if (line->state) add(static_cast<std::size_t>(line->step), *line->state);
    }
    if (out_.rows.size() == 1) lines_.fail("t", "expected two or more instants, got fewer");
    return std::move(out_);
  }

 private:
  /// Appends empty rows up to row `step`.
  void go_to(int step) {
    if (out_.rows.empty() && step != 0)
      lines_.fail("t", "expected 0 in the first row, got a later time");
    // an instant without lines in the file has no objects
    out_.rows.resize(std::max(out_.rows.size(), static_cast<std::size_t>(step) + 1));
  }

  void add(std::size_t step, const ObjectState& s) {
    if (const auto it = last_.find(s.id); it != last_.end()) {
      check_motion(it->second.second, s);
      if (it->second.first + 1 != step) stand(it->second.first + 1, step, s);
    }
    last_[s.id] = {step, s};
    out_.rows.back().push_back(s);
  }

  void check_motion(const ObjectState& before, const ObjectState& s) {
    const Box3d &a = before.box, &b = s.box;
    if (norm(Vec3{b.x - a.x, b.y - a.y, b.z - a.z}) > kMaxStep)
      lines_.fail("x", "expected at most 10 m in 0.1 s, got a jump");
    if (std::abs(wrap_angle(b.heading - a.heading)) > kMaxTurn)
      lines_.fail("heading", "expected at most 60 degrees in 0.1 s, got a turn of more");
    if (a.dx != b.dx || a.dy != b.dy || a.dz != b.dz || before.object_class != s.object_class)
      lines_.fail("dx", "expected one size and class of an object, got a different size or class");
  }

  /// Adds an object's state to the rows [first, last) in which the object is missing.
  void stand(std::size_t first, std::size_t last, const ObjectState& s) {
    if (last_.at(s.id).second != s)
      lines_.fail("id",
                  "expected steps of 0.1 s, or longer steps between equal states, got vehicle " +
                      std::to_string(s.id) + " again after a gap");
    for (std::size_t k = first; k < last; ++k) {
      auto& row = out_.rows[k];
      row.insert(std::ranges::upper_bound(row, s.id, {}, &ObjectState::id), s);
    }
  }

  TrajectoryLines lines_;
  std::map<int, std::pair<std::size_t, ObjectState>> last_;
  Trajectories out_;
};

}  // namespace

Trajectories read_trajectories(const std::filesystem::path& file) {
  return TrajectoryReader(file).read();
}

}  // namespace infrasim
