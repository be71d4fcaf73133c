#include "infrasim/scene/trajectories.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <iterator>
#include <limits>
#include <map>
#include <stdexcept>
#include <unordered_map>
#include <utility>

#include "infrasim/config/fields.h"

namespace infrasim {

namespace {

constexpr char kHeader[] = "t,id,class,x,y,z,heading,dx,dy,dz,speed";
constexpr char kPitchColumn[] = "pitch";
constexpr int kColumns = 11;  // number of columns without pitch
constexpr double kMostPitch = kPi / 6;
constexpr double kMaxStep = 10;       // m in 0.1 s: 360 km/h
constexpr double kMaxTurn = kPi / 3;  // rad in 0.1 s
constexpr double kMetreDigits = 1e4;
constexpr double kRadianDigits = 1e6;

double round_to(double value, double digits) { return std::round(value * digits) / digits; }

}  // namespace

Box3d MovingObject::at(double u) const {
  Box3d box = from;
  box.x += u * (to.x - from.x);
  box.y += u * (to.y - from.y);
  box.z += u * (to.z - from.z);
  box.heading = wrap_angle(from.heading + u * wrap_angle(to.heading - from.heading));
  box.pitch += u * (to.pitch - from.pitch);
  return box;
}

std::vector<MovingObject> objects_between(const std::vector<ObjectState>& before,
                                          const std::vector<ObjectState>& after) {
  std::vector<MovingObject> objects;
  objects.reserve(std::min(before.size(), after.size()));
  auto to = after.begin();
  for (const ObjectState& from : before) {
    while (to != after.end() && to->id < from.id) ++to;
    if (to == after.end()) break;
    if (to->id == from.id)
      objects.push_back(
          {from.id, from.object_class, from.box, to->box, (from.speed_m_s + to->speed_m_s) / 2});
  }
  return objects;
}

double row_position(double time_s) {
  constexpr double kTolerance = 1e-6;
  const double position = time_s / kRowStep_s, row = std::round(position);
  return std::abs(position - row) <= kTolerance ? row : position;
}

std::pair<int, int> rows_around(double position, int steps) {
  const int before = std::clamp(static_cast<int>(std::floor(position)), 0, steps);
  if (before == position) return {before, before};
  const int first = std::min(before, steps - 1);
  return {first, first + 1};
}

std::vector<ObjectState> states_at(double position, int steps, const RowOf& row) {
  const auto [first, last] = rows_around(position, steps);
  if (first == last) return row(first);
  std::vector<ObjectState> states;
  for (const MovingObject& o : objects_between(row(first), row(last)))
    states.push_back(rounded({o.id, o.object_class, o.at(position - first), o.speed_m_s}));
  return states;
}

bool Trajectories::has(double position) const {
  const auto [first, last] = rows_around(position, steps());
  return kept.empty() ||
         (kept[static_cast<std::size_t>(first)] && kept[static_cast<std::size_t>(last)]);
}

std::vector<ObjectState> Trajectories::moving_at(double position) const {
  return states_at(position, steps(), [&](int k) -> const std::vector<ObjectState>& {
    const auto row = static_cast<std::size_t>(k);
    if (!kept.empty() && !kept[row])
      throw std::logic_error("row " + std::to_string(k) + " of the trajectories was not kept");
    return rows[row];
  });
}

std::vector<MovingObject> Trajectories::between(double from, double to) const {
  return with_standing(objects_between(moving_at(from), moving_at(to)), standing);
}

std::vector<MovingObject> with_standing(std::vector<MovingObject> moving,
                                        const std::vector<ObjectState>& standing) {
  if (standing.empty()) return moving;
  std::vector<MovingObject> objects;
  objects.reserve(moving.size() + standing.size());
  auto next = standing.begin();
  const auto add_before = [&](int id) {
    for (; next != standing.end() && next->id < id; ++next)
      objects.push_back({next->id, next->object_class, next->box, next->box, next->speed_m_s});
  };
  for (const MovingObject& o : moving) {
    add_before(o.id);
    objects.push_back(o);
  }
  add_before(std::numeric_limits<int>::max());
  return objects;
}

std::vector<ObjectState> with_standing(const std::vector<ObjectState>& moving,
                                       const std::vector<ObjectState>& standing) {
  std::vector<ObjectState> states;
  states.reserve(moving.size() + standing.size());
  std::ranges::merge(moving, standing, std::back_inserter(states), {}, &ObjectState::id,
                     &ObjectState::id);
  return states;
}

TrajectoryKeeper::TrajectoryKeeper(std::vector<bool> asked, bool pitched, std::size_t most)
    : out_{{}, pitched, {}}, asked_(std::move(asked)), most_(most) {
  out_.rows.reserve(asked_.size());
}

void TrajectoryKeeper::take(const std::vector<ObjectState>& states) {
  const std::size_t k = out_.rows.size();
  const bool was_whole = states_ <= most_;
  states_ += states.size();
  if (states_ <= most_ || asked_[k])
    out_.rows.push_back(states);
  else
    out_.rows.emplace_back();
  if (!was_whole || states_ <= most_) return;
  for (std::size_t i = 0; i < k; ++i)
    if (!asked_[i]) std::vector<ObjectState>().swap(out_.rows[i]);
}

Trajectories TrajectoryKeeper::finish() {
  const std::size_t taken = out_.rows.size();
  if (taken < asked_.size() || states_ > most_) {
    out_.kept = std::move(asked_);
    out_.rows.resize(out_.kept.size());
    if (states_ <= most_) std::fill_n(out_.kept.begin(), taken, true);
    if (std::ranges::find(out_.kept, false) == out_.kept.end()) out_.kept.clear();
  }
  return std::move(out_);
}

ObjectState rounded(ObjectState state) {
  Box3d& b = state.box;
  for (double* v : {&b.x, &b.y, &b.z, &b.dx, &b.dy, &b.dz}) *v = round_to(*v, kMetreDigits);
  b.heading = round_to(wrap_angle(b.heading), kRadianDigits);
  b.pitch = round_to(b.pitch, kRadianDigits);
  state.speed_m_s = round_to(state.speed_m_s, kMetreDigits);
  return state;
}

namespace {

/// Makes lines of trajectories.csv.
class LineText {
 public:
  explicit LineText(bool pitched) : pitched_(pitched) {}

  std::string header() const {
    return std::string(kHeader) + (pitched_ ? std::string(",") + kPitchColumn : "") + "\n";
  }
  /// The line of a time without an object.
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
  static double time_s(int row) { return round_to(row * kRowStep_s, 10); }

  bool pitched_;
};

/// Finds the states that the text must have: the first and the last of consecutive equal states.
class EndsOfRuns {
 public:
  /// Takes the next row in the first pass.
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
      run.first = -1;  // the second pass begins
    }
  }
  /// Returns, in the second pass, whether the text has this state.
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
    int first, last;  ///< rows
  };
  struct Object {
    Run run;
    std::vector<int> ends;  ///< last rows of runs of several rows
    std::size_t next;       ///< index of the next end in the second pass
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
  std::string begin;  // written only if an object follows
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
  constexpr double kNobody = -1;  // stands for the blank id of a line with only a time
  if (!csv_.next_row()) return std::nullopt;
  const double t = csv_.number("t", 0, 1e5);
  TrajectoryLine line{static_cast<int>(std::llround(t / kRowStep_s)), std::nullopt};
  if (const double id = csv_.number_or(kNobody, "id", 0, 2147483647); id == kNobody) {
    for (int i = 2; i < kColumns + (pitched() ? 1 : 0); ++i)
      if (!csv_.cell().empty())
        csv_.fail("id", "expected a number, got '' in a row with more than its time");
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
  /// Appends instants up to a row.
  void go_to(int step) {
    if (out_.rows.empty() && step != 0) lines_.fail("t", "expected 0, got a start after 0");
    // an instant without rows is empty
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

  /// Adds a state to rows [first, last) that the object lacks.
  void stand(std::size_t first, std::size_t last, const ObjectState& s) {
    if (last_.at(s.id).second != s)
      lines_.fail("id", "expected steps of 0.1 s, or of more between equal states, got vehicle " +
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
