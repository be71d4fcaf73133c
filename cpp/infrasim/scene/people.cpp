#include "infrasim/scene/people.h"

#include <algorithm>
#include <functional>
#include <numeric>

#include "infrasim/config/fields.h"

namespace infrasim {

namespace {

constexpr int kMostPeople =
    1'000;  // maximum number of people per scene, because each is processed in every frame
constexpr double kOffLine_m = 0.1;  // assumed maximum lateral offset of a person from the line
constexpr double kApart_m =
    0.5;  // free gap between two people who pass each other, without their offsets from the line
// free length along the line up to which two people have their full lateral gap
constexpr double kAhead_m = 0.4;
constexpr double kMakesWay_s = 1.5;  // assumed duration of a lateral step
constexpr double kShortestWay =
    3;  // minimum length of a lateral step, in body lengths, for almost equal speeds
// number of the first random sample after those of the size
constexpr unsigned kAfterPersonSize = 7;

double fastest_of(const PersonSpeedConfig& speed) {
  return (speed.mean_km_h + 2 * speed.std_km_h) / 3.6;
}

const ObjectClass& object_class_of(PersonKind kind) {
  return class_of(kind == PersonKind::kPedestrian ? Class::kPedestrian : Class::kCyclist);
}

}  // namespace

/// Position and velocity of a person at one instant.
struct PeopleRow::Walk {
  const Person* person = nullptr;
  int number = 0;
  int lap = 0;
  double s = 0;         ///< position along the line, m; possibly beyond its ends
  double velocity = 0;  ///< velocity along the line, m/s
  double left = 0;      ///< offset to the left of the line, m
};

PeopleRow::PeopleRow(const Road& road, const PeopleConfig& row, const Rng& rng)
    : object_class_(&object_class_of(row.kind)),
      elevation_m_(road.config.elevation_m),
      line_(line_beside(road.centreline, row)) {
  const double way = std::max(2 * kShortestWay * object_class_->length_m.mean,
                              2 * kMakesWay_s * fastest_of(row.speed));
  beyond_m_ = way + 2 * object_class_->length_m.mean + kAhead_m;
  circle_m_ = line_.length() + 2 * beyond_m_;
  const auto n = std::llround(row.per_km * circle_m_ / 1000);
  for (std::int64_t i = 0; i < n; ++i) {
    const std::int64_t pair = i / 2;  // one person in each direction
    const Rng person_rng = rng.at(static_cast<std::uint64_t>(i) + 1);
    const double spread = std::clamp(person_rng.normal(kAfterPersonSize), -2.0, 2.0);
    people_.push_back(
        {sample_size(*object_class_, person_rng),
         circle_m_ * (static_cast<double>(pair) + person_rng.uniform(kAfterPersonSize + 2)) * 2 /
             static_cast<double>(n),
         (row.speed.mean_km_h + spread * row.speed.std_km_h) / 3.6, i % 2 == 1,
         kOffLine_m * (2 * person_rng.uniform(kAfterPersonSize + 3) - 1)});
  }
}

std::vector<PeopleRow::Walk> PeopleRow::walks_at(double time_s) const {
  std::vector<Walk> walks;
  for (std::size_t i = 0; i < people_.size(); ++i) {
    const Person& p = people_[i];
    const double gone = p.start_m + p.speed_m_s * time_s;
    const double lap = std::floor(gone / circle_m_);
    const double s = gone - lap * circle_m_ - beyond_m_;
    walks.push_back({&p, static_cast<int>(i), static_cast<int>(lap),
                     p.back ? line_.length() - s : s, p.back ? -p.speed_m_s : p.speed_m_s,
                     p.aside_m});
  }
  std::ranges::sort(walks, {}, &Walk::s);
  return walks;
}

namespace {

/// Returns the sort key of a person in the order from right to left, seen along the line. People
/// who move along the line are on the right, with faster people further left. People who move in
/// the opposite direction are on the left, with slower people further left. Everybody therefore
/// keeps to the right in their own direction, and faster people pass on the inner side.
double order_of(double velocity) {
  constexpr double kBeyondAll = 1'000;  // m/s, larger than all speeds
  return velocity > 0 ? velocity : kBeyondAll + velocity;
}

/// Returns a smooth step from 0 to 1 for u from 0 to 1, with zero slope at both ends.
double smooth(double u) {
  const double v = std::clamp(u, 0.0, 1.0);
  return v * v * (3 - 2 * v);
}

}  // namespace

/// Two people who are near each other, ordered from the right.
struct PeopleRow::Gap {
  std::size_t right, left;
  /// required lateral distance of the two people, without their offsets from the line
  double apart = 0;
  /// weight of `apart`: 1 while the two people pass each other, falling to 0 with increasing
  /// distance
  double near = 0;
};

/// Returns the weight with which other people avoid a person. The weight is 1 on the line and falls
/// to 0 at the ends of the line's extensions.
double PeopleRow::share(const Walk& walk) const {
  return smooth(1 + std::min(walk.s, line_.length() - walk.s) / beyond_m_);
}

/// Returns the gaps of all pairs of people who are near each other. `walks` is sorted by station.
/// `place` is each person's rank in the order from the right.
std::vector<PeopleRow::Gap> PeopleRow::gaps(const std::vector<Walk>& walks,
                                            const std::vector<std::size_t>& place) const {
  std::vector<Gap> out;
  for (std::size_t i = 0; i < walks.size(); ++i)
    for (std::size_t j = i + 1; j < walks.size() && walks[j].s - walks[i].s < beyond_m_; ++j) {
      const Walk &a = walks[i], &b = walks[j];
      const double lengths = a.person->size.dx + b.person->size.dx;
      const double closing = std::abs(a.velocity - b.velocity);
      const double way = std::max(kShortestWay * lengths / 2, kMakesWay_s * closing);
      const double near = smooth((lengths / 2 + kAhead_m + way - (b.s - a.s)) / way);
      const double apart = (a.person->size.dy + b.person->size.dy) / 2 + kApart_m;
      const auto [right, left] = std::minmax(place[i], place[j]);
      out.push_back({right, left, apart, near * std::min(share(a), share(b))});
    }
  return out;
}

/// Moves people aside. Each person has a limit on the right and a limit on the left, which follow
/// from the people on the two sides. Each person moves half way between both limits. People who are
/// near each other therefore keep the required distance.
void PeopleRow::make_way(std::vector<Walk>& walks) const {
  std::vector<std::size_t> from_right(walks.size()), place(walks.size());
  std::iota(from_right.begin(), from_right.end(), 0);
  std::ranges::sort(from_right, {}, [&](std::size_t i) {
    return std::pair(order_of(walks[i].velocity), walks[i].number);
  });
  for (std::size_t k = 0; k < from_right.size(); ++k) place[from_right[k]] = k;
  std::vector<Gap> all = gaps(walks, place);
  std::vector<double> left(walks.size()), right(walks.size());
  std::ranges::sort(all, {}, &Gap::left);
  for (const Gap& g : all)
    left[g.left] = std::max(left[g.left], g.near * (left[g.right] + g.apart));
  std::ranges::sort(all, std::greater{}, &Gap::right);
  for (const Gap& g : all)
    right[g.right] = std::max(right[g.right], g.near * (right[g.left] + g.apart));
  for (std::size_t i = 0; i < walks.size(); ++i)
    walks[i].left += (left[place[i]] - right[place[i]]) / 2;
}

ObjectState PeopleRow::state(const Walk& walk) const {
  const CurvePoint p = line_.at(walk.s);
  const Vec2 xy = p.position + walk.left * heading_vector(p.heading + kPi / 2);
  const VehicleSize& size = walk.person->size;
  const double heading = p.heading + (walk.person->back ? kPi : 0);
  const Box3d box{xy.x, xy.y, elevation_m_ + size.dz / 2, size.dx, size.dy, size.dz, heading};
  return rounded({0, object_class_->id, box, walk.person->speed_m_s});
}

void PeopleRow::append_at(double time_s, int first_id, int step,
                          std::vector<ObjectState>& out) const {
  std::vector<Walk> walks = walks_at(time_s);
  make_way(walks);
  for (const Walk& walk : walks) {
    if (walk.s < 0 || walk.s > line_.length()) continue;
    out.push_back(state(walk));
    out.back().id = first_id + walk.lap * step + walk.number;
  }
}

People::People(const SceneConfig& scene, std::span<const Curve> centrelines) {
  if (!scene.people) return;
  const Rng rng = Rng::of(scene.seed, "people");
  for (std::size_t i = 0; i < scene.people->size(); ++i) {
    const PeopleConfig& row = (*scene.people)[i];
    rows_.emplace_back(road_named(scene, centrelines, row.road, row.place), row, rng.at(i + 1));
    step_ += static_cast<int>(rows_.back().size());
    if (step_ > kMostPeople)
      config::fail(row.place, "per_km",
                   "expected at most " + std::to_string(kMostPeople) +
                       " people up to this row, got " + std::to_string(step_));
  }
}

std::vector<ObjectState> People::at(double time_s) const {
  std::vector<ObjectState> out;
  int first_id = kFirstPersonId;
  for (const PeopleRow& row : rows_) {
    row.append_at(time_s, first_id, step_, out);
    first_id += static_cast<int>(row.size());
  }
  std::ranges::sort(out, {}, &ObjectState::id);
  return out;
}

namespace {

// Group members stand on a Fermat spiral, whose points fill a disc evenly (Vogel 1979).
constexpr double kGoldenAngle = 2.399963229728653;  // rad, angle between consecutive members
// radius of member i, relative to sqrt(i + 0.5) times the mean spacing
constexpr double kSpiral = 0.58;
// maximum offset of a member from the spiral, relative to the mean spacing
constexpr double kOffSpiral = 0.05;
constexpr double kBody_m = 0.6;  // upper limit of half the diagonal of a pedestrian's footprint

}  // namespace

double radius_of(const StandingPeopleConfig& group) {
  return group.spacing_m * (kSpiral * std::sqrt(group.count) + kOffSpiral) + kBody_m;
}

std::vector<ObjectState> standing_people(const SceneConfig& scene) {
  std::vector<ObjectState> out;
  if (!scene.standing_people) return out;
  const Rng rng = Rng::of(scene.seed, "standing people");
  const ObjectClass& pedestrian = class_of(Class::kPedestrian);
  for (std::size_t g = 0; g < scene.standing_people->size(); ++g) {
    const StandingPeopleConfig& group = (*scene.standing_people)[g];
    const Rng of_group = rng.at(g + 1);
    const double turn = 2 * kPi * of_group.uniform(0);
    for (int i = 0; i < group.count; ++i) {
      if (out.size() == kMostPeople)
        config::fail(group.place, "count",
                     "expected up to " + std::to_string(kMostPeople) +
                         " standing people in a scene, got more with this group");
      const Rng person_rng = of_group.at(static_cast<std::uint64_t>(i) + 1);
      const VehicleSize size = sample_size(pedestrian, person_rng);
      const double radius = group.spacing_m * kSpiral * std::sqrt(i + 0.5);
      const Vec2 off = {2 * person_rng.uniform(kAfterPersonSize) - 1,
                        2 * person_rng.uniform(kAfterPersonSize + 1) - 1};
      const Vec2 xy = Vec2{group.x_m, group.y_m} +
                      radius * heading_vector(turn + i * kGoldenAngle) +
                      kOffSpiral * group.spacing_m / std::sqrt(2.0) * off;
      const double heading = kPi * (2 * person_rng.uniform(kAfterPersonSize + 2) - 1);
      const Box3d box{xy.x, xy.y, group.base_m + size.dz / 2, size.dx, size.dy, size.dz, heading};
      out.push_back(
          rounded({kFirstStandingPersonId + static_cast<int>(out.size()), pedestrian.id, box, 0}));
    }
  }
  return out;
}

}  // namespace infrasim
