#include "infrasim/scene/trajectories.h"

#include <algorithm>
#include <charconv>
#include <map>
#include <stdexcept>

#include "infrasim/config/fields.h"
#include "infrasim/io/csv.h"

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

std::vector<MovingObject> Trajectories::in_frame(int k) const {
  const auto n = static_cast<std::size_t>(k);
  if (!kept.empty() && !(kept[n] && kept[n + 1]))
    throw std::logic_error("trajectories of frame " + std::to_string(k) + " were not kept");
  return objects_between(rows[n], rows[n + 1]);
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

namespace {

/// Returns the frame that contains an instant of a late clock, or the nearest frame if none does.
int frame_of_late(double late_s, int instant, int frames) {
  return std::clamp(late_s < 0 ? instant - 1 : instant, 0, frames - 1);
}

}  // namespace

StateSink resample_at_clock_offset(double late_s, int frames, const StateSink& sink) {
  return [late = late_s / kFramePeriod, late_s, frames, sink, window = Trajectories{}, frame = -2,
          next = 0](const std::vector<ObjectState>& states) mutable {
    window.rows.push_back(states);
    if (window.rows.size() > 2) window.rows.erase(window.rows.begin());
    if (++frame < 0) return;
    for (; next <= frames && frame_of_late(late_s, next, frames) == frame; ++next) {
      std::vector<ObjectState> row;
      for (const MovingObject& o : window.in_frame(0))
        row.push_back(rounded({o.id, o.object_class, o.at(next + late - frame), o.speed_m_s}));
      sink(row);
    }
  };
}

Trajectories resample_at_clock_offset(const Trajectories& trajectories, double late_s) {
  Trajectories out{{}, trajectories.pitched, {}};
  const int frames = trajectories.frames();
  const StateSink late = resample_at_clock_offset(
      late_s, frames, [&](const auto& states) { out.rows.push_back(states); });
  for (const auto& states : trajectories.rows) late(states);
  if (trajectories.whole()) return out;
  for (int k = 0; k <= frames; ++k) {
    const auto frame = static_cast<std::size_t>(frame_of_late(late_s, k, frames));
    out.kept.push_back(trajectories.kept[frame] && trajectories.kept[frame + 1]);
  }
  return out;
}

ObjectState rounded(ObjectState state) {
  Box3d& b = state.box;
  for (double* v : {&b.x, &b.y, &b.z, &b.dx, &b.dy, &b.dz}) *v = round_to(*v, kMetreDigits);
  b.heading = round_to(wrap_angle(b.heading), kRadianDigits);
  b.pitch = round_to(b.pitch, kRadianDigits);
  state.speed_m_s = round_to(state.speed_m_s, kMetreDigits);
  return state;
}

std::string TrajectoryText::header() const {
  return std::string(kHeader) + (pitched_ ? std::string(",") + kPitchColumn : "") + "\n";
}

std::string TrajectoryText::nobody_at(int instant) const {
  const double t = round_to(instant * kFramePeriod, 10);
  return config::number_text(t) + std::string(pitched_ ? kColumns : kColumns - 1, ',') + "\n";
}

std::string TrajectoryText::end() const {
  return first_ < 0 || last_ == instants_ - 1 ? "" : nobody_at(instants_ - 1);
}

std::string TrajectoryText::rows(const std::vector<ObjectState>& states) {
  std::string text;
  if (!states.empty()) {
    last_ = instants_;
    if (first_ < 0) {
      first_ = instants_;
      if (first_ > 0) text = nobody_at(0);
    }
  }
  std::array<char, 32> buffer{};
  const auto append = [&](auto value, char end) {
    text.append(buffer.data(),
                std::to_chars(buffer.data(), buffer.data() + buffer.size(), value).ptr);
    text += end;
  };
  const double t = round_to(instants_ * kFramePeriod, 10);
  for (const ObjectState& s : states) {
    append(t, ',');
    append(s.id, ',');
    text += class_of(s.object_class).name;
    text += ',';
    for (const double v : {s.box.x, s.box.y, s.box.z, s.box.heading, s.box.dx, s.box.dy, s.box.dz})
      append(v, ',');
    append(s.speed_m_s, pitched_ ? ',' : '\n');
    if (pitched_) append(s.box.pitch, '\n');
  }
  ++instants_;
  return text;
}

std::string trajectories_csv(const Trajectories& trajectories) {
  TrajectoryText lines(trajectories.pitched);
  std::string text = lines.header();
  for (const auto& states : trajectories.rows) text += lines.rows(states);
  return text + lines.end();
}

namespace {

/// Reads a trajectory file row by row and reports errors with their position.
class TrajectoryReader {
 public:
  explicit TrajectoryReader(const std::filesystem::path& file)
      : csv_(file, kHeader, kPitchColumn) {}

  Trajectories read() {
    out_.pitched = csv_.has_last();
    while (csv_.next_row()) row();
    if (out_.rows.size() == 1) csv_.fail_row("t", "expected two or more instants, got fewer");
    return std::move(out_);
  }

 private:
  static constexpr double kNobody = -1;  // stands for the blank id of a row with only a time

  void row() {
    const double t = csv_.number("t", 0, 1e5);
    ObjectState s;
    const double id = csv_.number_or(kNobody, "id", 0, 2e9);
    if (id == kNobody) {
      for (int i = 2; i < kColumns + (csv_.has_last() ? 1 : 0); ++i)
        if (!csv_.cell().empty())
          csv_.fail("id", "expected a number, got '' in a row with more than its time");
      return go_to(t);
    }
    if (id != std::floor(id))
      csv_.fail("id", "expected a whole number, got '" + config::number_text(id) + "'");
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
    if (csv_.has_last()) s.box.pitch = csv_.number(kPitchColumn, -kMostPitch, kMostPitch);
    add(t, s);
  }

  /// Appends instants up to time t.
  void go_to(double t) {
    const auto step = static_cast<std::size_t>(std::llround(t / kFramePeriod));
    if (std::abs(t - static_cast<double>(step) * kFramePeriod) > 1e-6)
      csv_.fail_row("t", "expected a multiple of 0.1 s, got another time");
    if (step + 1 < out_.rows.size())
      csv_.fail_row("t", "expected ascending times, got a time before that of the row above");
    if (out_.rows.empty() && step != 0) csv_.fail_row("t", "expected 0, got a start after 0");
    out_.rows.resize(std::max(out_.rows.size(), step + 1));  // an instant without rows is empty
  }

  void add(double t, const ObjectState& s) {
    go_to(t);
    auto& row = out_.rows.back();
    if (!row.empty() && row.back().id >= s.id)
      csv_.fail_row("id", "expected ascending ids within an instant, got others");
    const std::size_t step = out_.rows.size() - 1;
    check_motion(step, s);
    last_[s.id] = {step, s};
    row.push_back(s);
  }

  void check_motion(std::size_t step, const ObjectState& s) {
    const auto it = last_.find(s.id);
    if (it == last_.end()) return;
    const auto& [last_step, before] = it->second;
    if (last_step + 1 != step)
      csv_.fail_row("id", "expected steps of 0.1 s, got vehicle " + std::to_string(s.id) +
                              " again after a gap");
    const Box3d &a = before.box, &b = s.box;
    if (norm(Vec3{b.x - a.x, b.y - a.y, b.z - a.z}) > kMaxStep)
      csv_.fail_row("x", "expected at most 10 m in 0.1 s, got a jump");
    if (std::abs(wrap_angle(b.heading - a.heading)) > kMaxTurn)
      csv_.fail_row("heading", "expected at most 60 degrees in 0.1 s, got a turn of more");
    if (a.dx != b.dx || a.dy != b.dy || a.dz != b.dz || before.object_class != s.object_class)
      csv_.fail_row("dx", "expected one size and class of an object, got others than before");
  }

  CsvReader csv_;
  std::map<int, std::pair<std::size_t, ObjectState>> last_;
  Trajectories out_;
};

}  // namespace

Trajectories read_trajectories(const std::filesystem::path& file) {
  return TrajectoryReader(file).read();
}

}  // namespace infrasim
