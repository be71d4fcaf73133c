#include "infrasim/scene/traffic.h"

#include <algorithm>
#include <deque>

#include "infrasim/config/fields.h"
#include "infrasim/core/rng.h"
#include "infrasim/scene/fleet.h"

namespace infrasim {

namespace {

// Intelligent Driver Model, usual values for mixed traffic (Treiber, Kesting 2013, table 11.2).
constexpr double kAcceleration = 1.5;    // m/s2
constexpr double kBraking = 2.0;         // m/s2, comfortable
constexpr double kHardestBraking = 8.0;  // m/s2
constexpr double kTimeGap = 1.2;         // s
constexpr double kCommitBraking = 3.0;   // m/s2: who would need more at a red signal drives on
constexpr double kLookahead = 100;       // m at least; to a comfortable stop for who is faster
constexpr double kTailClear = 10;        // m into a junction until a turning tail frees the lane
constexpr double kRingGap = 5;       // s that who enters a roundabout needs before the next comes
constexpr double kMaxLateral = 0.3;  // m, constant offset of a driver from the lane's centre

struct Vehicle {
  int id = 0;
  const ObjectClass* object_class = nullptr;
  double dx = 0, dy = 0, dz = 0;
  double desired_speed = 0;
  double lateral = 0;
  double turn_choice = 0;  ///< uniform draw
  int lane = 0;
  int last_lane = -1;
  int next_lane = -1;
  double s = 0;
  double speed = 0;
  bool committed = false;  ///< past the point where it could still stop at its signal
};

/// From the middle of a vehicle to each of the two points that follow its path. So far apart, a
/// vehicle in a bend reaches as far inwards with its side as outwards with its corners.
double half_base(const Vehicle& v) { return v.dx / std::sqrt(8.0); }

/// How far a vehicle reaches beside its path in a bend, driving `outwards` metres outside of it.
double reach(const Vehicle& v, double radius, double outwards) {
  if (std::isinf(radius)) return v.dy / 2 + std::abs(outwards);
  const double a = std::min(half_base(v), radius);
  const double middle = std::sqrt(radius * radius - a * a) + outwards;
  return std::max(std::hypot(middle + v.dy / 2, v.dx / 2) - radius, radius - middle + v.dy / 2);
}

/// What limits a driver: free distance ahead of the bumper and the speed at its end.
struct Leader {
  double gap = kInf;
  double speed = 0;
};

double lookahead(double speed) { return std::max(kLookahead, speed * speed / (2 * kBraking)); }

double idm_acceleration(double speed, double desired, const Leader& leader) {
  const double ratio = speed / desired;
  double acceleration = 1 - ratio * ratio * ratio * ratio;
  if (leader.gap < lookahead(speed)) {
    const double closing =
        speed * (speed - leader.speed) / (2 * std::sqrt(kAcceleration * kBraking));
    const double wanted = kStandstillGap_m + std::max(0.0, speed * kTimeGap + closing);
    const double squeeze = wanted / std::max(leader.gap, 0.1);
    acceleration -= squeeze * squeeze;
  }
  return std::clamp(kAcceleration * acceleration, -kHardestBraking, kAcceleration);
}

/// Greens of one junction, one approach after the other; the next one starts when the junction
/// is empty, so that paths that cross are never driven together.
struct Signal {
  std::vector<int> approaches;
  std::size_t current = 0;
  bool green = true;
  double since = 0;
};

class Traffic {
 public:
  explicit Traffic(const Site& site)
      : config_(*site.scene.traffic),
        network_(site.network),
        rng_(Rng::of(site.scene.seed, "traffic")),
        lanes_(network_.lanes.size()),
        signals_(network_.junctions.size()),
        arms_(network_.approach_junctions.size()),
        near_(network_.junctions.size()) {
    for (std::size_t a = 0; a < network_.approach_junctions.size(); ++a)
      signals_[network_.approach_junctions[a]].approaches.push_back(static_cast<int>(a));
    for (std::size_t i = 0; i < network_.lanes.size(); ++i) {
      const Lane& lane = network_.lanes[i];
      if (lane.entry) entries_.push_back(static_cast<int>(i));
      if (lane.approach >= 0) arms_[lane.approach].lanes.push_back(static_cast<int>(i));
      if (const int junction = junction_near(lane); junction >= 0)
        near_[junction].push_back(static_cast<int>(i));
      narrowest_m_ = std::min(narrowest_m_, lane.width_m);
      if (lane.turn == Turn::kStraight && !on_ring(lane))
        tightest_radius_ = std::min(tightest_radius_, lane.curve.tightest_radius());
    }
    for (const auto& [name, share] : config_.class_shares)
      if (share > 0) check_fits(*find_class(name));
    fill();
  }

  void step() {
    update_signals();
    choose_next_lanes();
    look_for_gaps();
    commit_at_green();
    std::vector<std::vector<double>> acceleration(lanes_.size());
    for (std::size_t lane = 0; lane < lanes_.size(); ++lane)
      for (std::size_t i = 0; i < lanes_[lane].size(); ++i)
        acceleration[lane].push_back(accelerate(static_cast<int>(lane), i));
    for (std::size_t lane = 0; lane < lanes_.size(); ++lane)
      for (std::size_t i = 0; i < lanes_[lane].size(); ++i)
        advance(lanes_[lane][i], acceleration[lane][i]);
    move_between_lanes();
    spawn();
  }

  std::vector<ObjectState> states() const {
    std::vector<ObjectState> row;
    for (const auto& lane : lanes_)
      for (const Vehicle& v : lane) row.push_back(state(v));
    std::ranges::sort(row, {}, &ObjectState::id);
    return row;
  }

 private:
  using Queue = std::deque<Vehicle>;  ///< vehicles of a lane, the one furthest ahead first

  /// The lanes of one direction of a road that end at a junction.
  struct Arm {
    std::vector<int> lanes;
    bool gap = false;  ///< that who enters a roundabout there has
  };

  /// The junction that a lane is in, leads to or leaves; -1: none.
  int junction_near(const Lane& lane) const {
    if (lane.approach >= 0) return network_.approach_junctions[lane.approach];
    return std::max(lane.junction, lane.leaves);
  }

  const Lane& lane_of(const Vehicle& v) const { return network_.lanes[v.lane]; }
  bool on_ring(const Lane& lane) const {
    return lane.junction >= 0 && network_.rings[lane.junction];
  }

  // --- population -------------------------------------------------------------------------

  /// Vehicles over the lanes outside junctions, evenly at the density, but for those that stand
  /// further back for the length of who is ahead; who has no room waits for an entry.
  void fill() {
    for (std::size_t i = 0; i < network_.lanes.size(); ++i) {
      const Lane& lane = network_.lanes[i];
      if (lane.junction >= 0) continue;
      const double length = lane.curve.length();
      density_carry_ += config_.vehicles_per_km_lane * length / 1000;
      const int count = static_cast<int>(density_carry_);
      density_carry_ -= count;
      for (int k = count - 1; k >= 0; --k) {
        Vehicle v = new_vehicle(static_cast<int>(i));
        v.s = length * (k + 0.5) / count;
        if (!lanes_[i].empty())
          v.s = std::min(v.s, lanes_[i].back().s - spacing(v, lanes_[i].back()));
        v.speed = speed_at_start(v, v.desired_speed / 2);
        if (v.s < v.dx / 2)
          ++waiting_;
        else
          lanes_[i].push_back(v);
      }
    }
  }

  /// As wished, if the vehicle can stop at the signal ahead.
  double speed_at_start(const Vehicle& v, double desired) const {
    if (lane_of(v).approach < 0) return desired;
    return std::min(desired, std::sqrt(2 * kBraking * std::max(0.0, to_stop_line(v))));
  }

  /// Between the centres of two that stand one behind the other.
  static double spacing(const Vehicle& v, const Vehicle& ahead) {
    return (v.dx + ahead.dx) / 2 + kStandstillGap_m;
  }

  Vehicle new_vehicle(int lane) {
    const Rng rng = rng_.at(static_cast<std::uint64_t>(next_id_) + 1);
    Vehicle v;
    v.id = next_id_++;
    v.lane = lane;
    v.object_class = &class_at(config_.class_shares, rng.uniform(0));
    const VehicleSize size = draw_size(*v.object_class, rng);
    v.dx = size.dx;
    v.dy = size.dy;
    v.dz = size.dz;
    const double deviation = std::clamp(rng.normal(7), -2.5, 2.5);
    v.desired_speed =
        std::max(1.0, (config_.speed.mean_km_h + config_.speed.std_km_h * deviation) / 3.6);
    const double room =
        std::clamp((network_.lanes[lane].width_m - v.dy) / 2 - 0.25, 0.0, kMaxLateral);
    v.lateral = room * (2 * rng.uniform(9) - 1);
    fit_lanes(v);
    v.turn_choice = rng.uniform(10);
    return v;
  }

  void check_fits(const ObjectClass& row) const {
    Vehicle v;
    v.dx = row.length_m.mean;
    v.dy = row.width_m.mean;
    if (reach(v, tightest_radius_, 0) <= narrowest_m_ / 2) return;
    const auto metres = [](double m) { return config::number_text(std::round(100 * m) / 100); };
    config::fail(config_.place, "class_shares",
                 "found " + std::string(row.name) +
                     ", allowed vehicles that stay in the narrowest "
                     "lane, " +
                     metres(narrowest_m_) + " m, round the tightest bend, " +
                     metres(tightest_radius_) + " m");
  }

  /// Narrower, and nearer to the lane's centre, where the scene's tightest bend would else take it
  /// out of its lane, and there is no room beside another long one.
  void fit_lanes(Vehicle& v) const {
    const double beside = reach(v, tightest_radius_, 0) - v.dy / 2;
    v.dy = std::min(v.dy, narrowest_m_ - 2 * beside);
    const double free = narrowest_m_ / 2 - v.dy / 2 - beside;
    v.lateral = std::clamp(v.lateral, -free, free);
  }

  /// Puts the vehicles that wait for an entry where the last one ahead leaves room.
  void spawn() {
    for (std::size_t n = waiting_; n > 0; --n) {
      const int lane =
          entries_[rng_.at(1'000'000'001ULL + spawn_draws_++).bits(0) % entries_.size()];
      Vehicle v = new_vehicle(lane);
      v.s = v.dx / 2;
      v.speed = speed_at_start(v, v.desired_speed);
      if (!lanes_[lane].empty()) {
        const Vehicle& ahead = lanes_[lane].back();
        const double gap = ahead.s - ahead.dx / 2 - v.dx;
        v.speed = std::min(v.speed, ahead.speed);
        if (gap < kStandstillGap_m + kTimeGap * v.speed) {
          --next_id_;
          continue;
        }
      }
      lanes_[lane].push_back(v);
      --waiting_;
    }
  }

  // --- driving ----------------------------------------------------------------------------

  void choose_next_lanes() {
    for (auto& lane : lanes_)
      for (Vehicle& v : lane)
        if (v.next_lane < 0 && !lane_of(v).next.empty()) v.next_lane = next_lane(v);
  }

  int next_lane(const Vehicle& v) const {
    const Lane& lane = lane_of(v);
    if (lane.next.size() == 1) return lane.next.front();
    const JunctionConfig& junction = network_.junctions[network_.approach_junctions[lane.approach]];
    const auto way = [&](Turn turn) {
      return std::ranges::find(lane.next, turn,
                               [&](int next) { return network_.lanes[next].turn; });
    };
    if (way(Turn::kStraight) == lane.next.end()) {  // one lane that ends at a T
      const double shares = junction.left_share + junction.right_share;
      const double left = shares > 0 ? junction.left_share / shares : 0.5;
      const bool goes_left = v.turn_choice < left;
      const int wanted = *way(goes_left ? Turn::kLeft : Turn::kRight);
      const int other = *way(goes_left ? Turn::kRight : Turn::kLeft);
      const bool only_other =
          !stays_in_lane(v, network_.lanes[wanted]) && stays_in_lane(v, network_.lanes[other]);
      return only_other ? other : wanted;
    }
    for (const int next : lane.next) {
      const Turn turn = network_.lanes[next].turn;
      // A turn leaves from one of the lanes only, so its share of that lane is larger.
      const auto lanes = static_cast<double>(arms_[lane.approach].lanes.size());
      if (!stays_in_lane(v, network_.lanes[next])) continue;
      if (turn == Turn::kLeft && v.turn_choice < junction.left_share * lanes) return next;
      if (turn == Turn::kRight && v.turn_choice > 1 - junction.right_share * lanes) return next;
    }
    return *way(Turn::kStraight);
  }

  /// On a turn that it takes, a vehicle leaves the lanes beside it free.
  static bool stays_in_lane(const Vehicle& v, const Lane& turn) {
    const double outwards = turn.turn == Turn::kRight ? v.lateral : -v.lateral;
    return reach(v, turn.curve.tightest_radius(), outwards) <= turn.width_m / 2;
  }

  double accelerate(int lane, std::size_t i) const {
    const Vehicle& v = lanes_[lane][i];
    Leader leader = vehicle_ahead(lane, i);
    const Leader signal = red_signal(v);
    if (signal.gap < leader.gap) leader = signal;
    return idm_acceleration(v.speed, target_speed(v), leader);
  }

  /// The desired speed, lower when a slow lane is near enough to brake for.
  double target_speed(const Vehicle& v) const {
    const double here = std::min(v.desired_speed, lane_of(v).speed_limit_m_s);
    if (v.next_lane < 0) return here;
    const double limit = network_.lanes[v.next_lane].speed_limit_m_s;
    const double distance = std::max(0.0, lane_of(v).curve.length() - v.s - v.dx / 2);
    return std::min(here, std::sqrt(limit * limit + 2 * kBraking / 2 * distance));
  }

  Leader vehicle_ahead(int lane, std::size_t i) const {
    const Vehicle& v = lanes_[lane][i];
    Leader best;
    const auto consider = [&](const Vehicle& other, double distance) {
      const double gap = distance - (v.dx + other.dx) / 2;
      if (gap < best.gap) best = {gap, other.speed};
    };
    if (i > 0) consider(lanes_[lane][i - 1], lanes_[lane][i - 1].s - v.s);
    double to_end = network_.lanes[lane].curve.length() - v.s;
    // Tails of vehicles that have just turned off still block the lane.
    for (const int next : network_.lanes[lane].next)
      for (const Vehicle& other : lanes_[next])
        if (other.s - other.dx / 2 < kTailClear) consider(other, to_end + other.s);
    for_each_on_ring(network_.lanes[lane].junction, [&](const Ring& ring, const Vehicle& other) {
      const double ahead = ring.along(position(v), position(other));
      if (other.id != v.id && stays_on(ring, v) && ahead < ring.config.radius_m)
        consider(other, ahead);
    });
    for (int next = v.next_lane; next >= 0 && to_end < lookahead(v.speed);) {
      if (!lanes_[next].empty()) {
        consider(lanes_[next].back(), to_end + lanes_[next].back().s);
        break;
      }
      to_end += network_.lanes[next].curve.length();
      next = network_.lanes[next].next.empty() ? -1 : network_.lanes[next].next.front();
    }
    return best;
  }

  double to_stop_line(const Vehicle& v) const { return lane_of(v).curve.length() - v.s - v.dx / 2; }

  /// Who could no longer stop if a green signal turned red will drive on.
  void commit_at_green() {
    for (auto& lane : lanes_)
      for (Vehicle& v : lane) {
        if (v.committed || lane_of(v).approach < 0 || !is_green(lane_of(v).approach)) continue;
        const double gap = to_stop_line(v);
        v.committed = !(gap > 0 && v.speed * v.speed / (2 * gap) < kCommitBraking);
      }
  }

  /// The stop line of a red signal, as a vehicle that stands a little behind it.
  Leader red_signal(const Vehicle& v) const {
    const int approach = lane_of(v).approach;
    if (approach < 0 || v.committed || is_green(approach)) return {};
    return {to_stop_line(v) + kStandstillGap_m - 0.5, 0};
  }

  void advance(Vehicle& v, double acceleration) {
    const double speed = std::max(0.0, v.speed + acceleration * kFramePeriod);
    v.s += (v.speed + speed) / 2 * kFramePeriod;
    v.speed = speed;
  }

  void move_between_lanes() {
    for (std::size_t i = 0; i < lanes_.size(); ++i)
      while (!lanes_[i].empty()) {
        Vehicle v = lanes_[i].front();
        const double length = network_.lanes[i].curve.length();
        const bool leaves = network_.lanes[i].next.empty();
        if (v.s < length - (leaves ? v.dx / 2 : 0)) break;
        lanes_[i].pop_front();
        if (leaves) {
          ++waiting_;
          continue;
        }
        v.s -= length;
        v.last_lane = v.lane;
        v.lane = v.next_lane;
        v.next_lane = -1;
        if (network_.lanes[v.lane].junction < 0) v.committed = false;
        lanes_[v.lane].push_back(v);
      }
  }

  // --- signals ----------------------------------------------------------------------------

  bool stays_on(const Ring& ring, const Vehicle& v) const {
    return ring.holds(position(v)) || v.s < lane_of(v).curve.length() / 2;
  }

  /// Each vehicle that enters or is on the ring of a junction, if that has one; not who leaves it.
  template <class Take>
  void for_each_on_ring(int junction, const Take& take) const {
    if (junction < 0 || !network_.rings[junction]) return;
    const Ring& ring = *network_.rings[junction];
    for (const int i : near_[junction])
      if (network_.lanes[i].junction == junction)
        for (const Vehicle& v : lanes_[i])
          if (stays_on(ring, v)) take(ring, v);
  }

  void look_for_gaps() {
    for (std::size_t a = 0; a < arms_.size(); ++a)
      if (network_.rings[network_.approach_junctions[a]])
        arms_[a].gap = has_gap(static_cast<int>(a));
  }

  /// Who enters a roundabout gives way to whom it would make brake, but for those before it from
  /// its own arm.
  bool has_gap(int approach) const {
    const Curve& lane = network_.lanes[arms_[approach].lanes.front()].curve;
    const Vec2 end = lane.at(lane.length()).position;
    bool free = true;
    for_each_on_ring(network_.approach_junctions[approach],
                     [&](const Ring& ring, const Vehicle& v) {
                       const Vec2 entry = ring.entry(end);
                       const bool ahead = network_.lanes[v.last_lane].approach == approach;
                       const double away = ring.along(position(v), entry) - v.dx / 2;
                       free = free && (ahead || away > kRingGap * lane_of(v).speed_limit_m_s);
                     });
    return free;
  }

  bool is_green(int approach) const {
    if (network_.rings[network_.approach_junctions[approach]]) return arms_[approach].gap;
    const Signal& signal = signals_[network_.approach_junctions[approach]];
    return signal.green && signal.approaches[signal.current] == approach;
  }

  void update_signals() {
    for (std::size_t j = 0; j < signals_.size(); ++j) {
      if (network_.rings[j]) continue;
      Signal& signal = signals_[j];
      const SignalConfig timing = network_.junctions[j].signal.value_or(SignalConfig{});
      signal.since += kFramePeriod;
      if (signal.green && signal.since >= timing.green_s) {
        signal.green = false;
        signal.since = 0;
      } else if (!signal.green && signal.since >= timing.all_red_s &&
                 is_clear(static_cast<int>(j))) {
        signal.green = true;
        signal.since = 0;
        signal.current = (signal.current + 1) % signal.approaches.size();
      }
    }
  }

  /// No vehicle is in the junction, on its way in, or with its tail still there. What happens at
  /// another junction does not count.
  bool is_clear(int junction) const {
    for (const int i : near_[junction]) {
      const Lane& lane = network_.lanes[i];
      for (const Vehicle& v : lanes_[i]) {
        if (lane.junction == junction || (lane.approach >= 0 && v.committed)) return false;
        if (lane.leaves == junction && v.s < v.dx / 2 + 1) return false;
      }
    }
    return true;
  }

  Vec2 position(const Vehicle& v) const { return lane_of(v).curve.at(v.s).position; }

  /// The path of a vehicle at a station of its lane, or beyond its ends.
  Vec2 on_path(const Vehicle& v, double s) const {
    const Lane& lane = lane_of(v);
    const double length = lane.curve.length();
    const int next = v.next_lane < 0 && lane.next.size() == 1 ? lane.next.front() : v.next_lane;
    if (s > length && next >= 0) return network_.lanes[next].curve.at(s - length).position;
    if (s >= 0 || v.last_lane < 0) return lane.curve.at(s).position;
    const Curve& before = network_.lanes[v.last_lane].curve;
    return before.at(before.length() + s).position;
  }

  ObjectState state(const Vehicle& v) const {
    const Vec2 rear = on_path(v, v.s - half_base(v)), front = on_path(v, v.s + half_base(v));
    const double heading = std::atan2(front.y - rear.y, front.x - rear.x);
    const Vec2 xy = 0.5 * (rear + front) + v.lateral * heading_vector(heading + kPi / 2);
    return rounded({v.id,
                    v.object_class->id,
                    {xy.x, xy.y, lane_of(v).elevation_m + v.dz / 2, v.dx, v.dy, v.dz, heading},
                    v.speed});
  }

  const TrafficConfig& config_;
  const LaneNetwork& network_;
  Rng rng_;
  std::vector<Queue> lanes_;
  std::vector<Signal> signals_;
  std::vector<Arm> arms_;               ///< of each approach
  std::vector<std::vector<int>> near_;  ///< lanes in, to and from each junction, in their order
  std::vector<int> entries_;
  double tightest_radius_ = kInf;  ///< m, of the lanes, turns at junctions left out
  double narrowest_m_ = kInf;      ///< width of a lane
  double density_carry_ = 0;
  std::size_t waiting_ = 0;
  std::uint64_t spawn_draws_ = 0;
  int next_id_ = 0;
};

}  // namespace

void simulate_traffic(const Site& site, const StateSink& sink, int instants) {
  Traffic traffic(site);
  for (double t = 0; t < site.scene.traffic->warm_up_s; t += kFramePeriod) traffic.step();
  for (int k = 0; k < instants; ++k) {
    if (k > 0) traffic.step();
    sink(traffic.states());
  }
}

void simulate_traffic(const Site& site, const StateSink& sink) {
  simulate_traffic(site, sink, frame_count(site.scene.duration_s) + 1);
}

Trajectories simulate_traffic(const Site& site) {
  Trajectories out;
  simulate_traffic(site, [&](const auto& states) { out.rows.push_back(states); });
  return out;
}

}  // namespace infrasim
