#include "infrasim/scene/lane_network.h"

#include <algorithm>

#include "infrasim/config/fields.h"
#include "infrasim/core/math.h"

namespace infrasim {

namespace {

constexpr double kStopLineGap = 3;  // m, distance from the crossing road's edge to the stop line
constexpr double kLeastArm = 10;    // m, minimum length of a road on each side of its junction
// m; at a T junction, the stop line moves back by this length times the cosine of the angle between
// the roads, because of the tails of turning vehicles
constexpr double kSharpTurnGap = 8;
constexpr double kLateralAcceleration = 2;     // m/s2, maximum that drivers accept in a turn
constexpr double kSharpestCrossing = kPi / 4;  // minimum angle between two roads
constexpr double kAngleSlack = 1e-6;           // tolerance for angles that should be equal
constexpr double kMostBend = kPi / 6;          // maximum bend of a road within its junction
constexpr double kSharpestRing = kPi / 3;      // minimum angle between two arms of a roundabout

/// One direction of a road at a junction: lane indices, inner lane first.
struct Arm {
  double heading = 0;
  std::vector<int> in;
  std::vector<int> out;
};

struct RoadLine {
  const RoadConfig* config = nullptr;
  const Curve& curve;
  std::optional<JunctionCut> cut;
};

std::optional<Vec2> crossing(const Curve& a, const Curve& b) {
  for (std::size_t i = 0; i + 1 < a.samples().size(); ++i)
    for (std::size_t j = 0; j + 1 < b.samples().size(); ++j) {
      const Vec2 p = a.samples()[i].position, r = a.samples()[i + 1].position - p;
      const Vec2 q = b.samples()[j].position, s = b.samples()[j + 1].position - q;
      const double det = cross(r, s);
      if (std::abs(det) < 1e-9) continue;
      const double t = cross(q - p, s) / det, u = cross(q - p, r) / det;
      if (t >= 0 && t <= 1 && u >= 0 && u <= 1) return p + t * r;
    }
  return std::nullopt;
}

/// Returns the point where two roads cross, or where one road ends on the carriageway of the other.
std::optional<Vec2> meeting(const RoadLine& a, const RoadLine& b) {
  if (const auto point = crossing(a.curve, b.curve)) return point;
  for (const auto& [stem, main] : {std::pair{&a, &b}, std::pair{&b, &a}})
    for (const double s : {0.0, stem->curve.length()}) {
      const Vec2 end = stem->curve.at(s).position;
      const Vec2 foot = main->curve.at(main->curve.project(end)).position;
      if (norm(end - foot) <= carriageway_half_width(main->config->lanes)) return foot;
    }
  return std::nullopt;
}

/// Returns whether a road ends within `reach` of a station.
bool is_end(const RoadLine& road, double s, double reach) {
  return std::min(s, road.curve.length() - s) <= reach;
}

/// Returns the part of a road inside a junction at a station. The part ends at an end of the road
/// that lies within `reach`.
JunctionCut cut_at(const JunctionConfig& junction, int index, const RoadLine& road, double s,
                   double half, double reach) {
  const double length = road.curve.length();
  if (s <= reach && length - s > half + kLeastArm) return {index, 0, s + half};
  if (length - s <= reach && s > half + kLeastArm) return {index, s - half, length};
  if (s < half + kLeastArm || s > length - half - kLeastArm)
    config::fail(junction.place, "roads",
                 "expected a junction further from the ends of the road, or a road that ends on "
                 "the other, got a junction within 10 m of the end of '" +
                     road.config->name + "'");
  return {index, s - half, s + half};
}

bool ends_at(const RoadLine& road) {
  return road.cut->from == 0 || road.cut->to == road.curve.length();
}

/// Returns half the length of the part of a road that a crossing road and its footways cover.
double half_crossing(const LanesConfig& road, const LanesConfig& other, double angle) {
  const double across = outer_half_width(other);
  const double along = carriageway_half_width(road) * std::abs(math::cos(angle));
  return (across + along) / std::abs(math::sin(angle));
}

/// Returns the angle between two lines, 0 to pi / 2 radians.
double between_lines(double heading_a, double heading_b) {
  const double angle = std::abs(wrap_angle(heading_a - heading_b));
  return std::min(angle, kPi - angle);
}

std::string degrees_text(double angle) {
  return config::number_text(std::round(10 * deg(angle)) / 10) + " degrees";
}

void check_heights(const JunctionConfig& junction, const RoadConfig& a, const RoadConfig& b) {
  if (a.elevation_m != b.elevation_m)
    config::fail(junction.place, "roads",
                 "expected roads at equal heights, got '" + a.name + "' at " +
                     config::number_text(a.elevation_m) + " m and '" + b.name + "' at " +
                     config::number_text(b.elevation_m) + " m");
}

/// Checks that each road is nearly straight within the junction, and that the angle between the two
/// roads is large enough.
void check_angles(const JunctionConfig& junction, const RoadLine& a, const RoadLine& b) {
  for (const RoadLine* road : {&a, &b}) {
    const double in = road->curve.at(road->cut->from).heading;
    const double bend = std::abs(wrap_angle(road->curve.at(road->cut->to).heading - in));
    if (bend > kMostBend)
      config::fail(junction.place, "roads",
                   "expected a bend of up to " + degrees_text(kMostBend) +
                       " within the junction, got '" + road->config->name + "' with a bend of " +
                       degrees_text(bend));
  }
  for (const double s : {a.cut->from, a.cut->to})
    for (const double t : {b.cut->from, b.cut->to}) {
      const double angle = between_lines(a.curve.at(s).heading, b.curve.at(t).heading);
      const double least = junction.roundabout ? kSharpestRing : kSharpestCrossing;
      if (angle < least - kAngleSlack)
        config::fail(junction.place, "roads",
                     "expected arms at " + degrees_text(least) +
                         " or more to each other, got arms at " + degrees_text(angle));
    }
}

/// Makes the ring of a roundabout. The ring has one lane, and its roads must have one lane each
/// way.
Ring ring_at(const JunctionConfig& junction, Vec2 centre, const RoadConfig& a,
             const RoadConfig& b) {
  for (const RoadConfig* road : {&a, &b})
    if (road->lanes.each_way > 1 || is_one_way(road->lanes))
      config::fail(junction.place, "roundabout",
                   "expected roads with one lane each way, got '" + road->name +
                       "' with several or one-way lanes");
  return {a.name + "_" + b.name + "_ring", centre, a.elevation_m, *junction.roundabout};
}

/// Sets the part of both roads that is inside a junction. Returns the ring if the junction is a
/// roundabout, otherwise no value.
std::optional<Ring> cut_roads(const SceneConfig& scene, int index, std::vector<RoadLine>& roads) {
  const JunctionConfig& junction = scene.junctions[static_cast<std::size_t>(index)];
  RoadLine& a = roads[road_index(scene, junction.roads[0], junction.place, "roads")];
  RoadLine& b = roads[road_index(scene, junction.roads[1], junction.place, "roads")];
  const auto point = meeting(a, b);
  if (&a == &b || !point)
    config::fail(
        junction.place, "roads",
        "expected two roads that cross, or one that ends on the other, got roads that do not meet");
  check_heights(junction, *a.config, *b.config);
  const std::array stations{a.curve.project(*point), b.curve.project(*point)};
  const double angle =
      between_lines(a.curve.at(stations[0]).heading, b.curve.at(stations[1]).heading);
  const double least = std::max(angle, kSharpestCrossing);
  const double reach_a = outer_half_width(b.config->lanes) / math::sin(least);
  const double reach_b = outer_half_width(a.config->lanes) / math::sin(least);
  const bool t = is_end(a, stations[0], reach_a) || is_end(b, stations[1], reach_b);
  const double gap = kStopLineGap + (t ? kSharpTurnGap * math::cos(least) : 0);
  std::optional<Ring> ring;
  if (junction.roundabout) ring = ring_at(junction, *point, *a.config, *b.config);
  for (RoadLine* road : {&a, &b}) {
    if (road->cut)
      config::fail(
          junction.place, "roads",
          "expected one junction on a road, got a second junction on '" + road->config->name +
              "'; for a network of roads, import a site with lanes and trajectories (pyinfra "
              "site import, pyinfra site traffic)");
    const bool first = road == &a;
    const LanesConfig& other = (first ? b : a).config->lanes;
    const double half =
        ring ? ring->reach_m() : half_crossing(road->config->lanes, other, least) + gap;
    road->cut =
        cut_at(junction, index, *road, stations[first ? 0 : 1], half, first ? reach_a : reach_b);
  }
  if (ends_at(a) && ends_at(b))
    config::fail(
        junction.place, "roads",
        "expected a road that continues beyond the junction, got two roads that end there");
  check_angles(junction, a, b);
  return ring;
}

int add_lane(LaneNetwork& network, const RoadConfig& road, Curve curve) {
  Lane lane;
  lane.curve = std::move(curve);
  lane.elevation_m = road.elevation_m;
  lane.width_m = road.lanes.width_m;
  network.lanes.push_back(std::move(lane));
  return static_cast<int>(network.lanes.size()) - 1;
}

/// Adds the lanes of one direction of a road. `along` is the centreline in the direction of
/// traffic.
void add_direction(LaneNetwork& network, const RoadLine& road, const Curve& along, bool reversed,
                   std::vector<std::vector<Arm>>& arms) {
  const LanesConfig& cross_section = road.config->lanes;
  Arm arm;
  double stop = 0, resume = 0;
  if (road.cut) {
    stop = reversed ? along.length() - road.cut->to : road.cut->from;
    resume = reversed ? along.length() - road.cut->from : road.cut->to;
    arm.heading = along.at(stop > 0 ? stop : resume).heading;
  }
  const double inner =
      is_one_way(cross_section) ? -lanes_half_width(cross_section) : cross_section.median_m / 2;
  for (int i = 0; i < cross_section.each_way; ++i) {
    const double right = inner + (i + 0.5) * cross_section.width_m;
    const auto lane_curve = [&](double s0, double s1) { return along.part(s0, s1).offset(-right); };
    if (!road.cut) {
      network.lanes[add_lane(network, *road.config, lane_curve(0, along.length()))].entry = true;
      continue;
    }
    if (stop > 0) {
      arm.in.push_back(add_lane(network, *road.config, lane_curve(0, stop)));
      network.lanes[arm.in.back()].entry = true;
      network.lanes[arm.in.back()].approach = static_cast<int>(network.approach_junctions.size());
    }
    if (resume < along.length()) {
      arm.out.push_back(add_lane(network, *road.config, lane_curve(resume, along.length())));
      network.lanes[arm.out.back()].leaves = road.cut->junction;
    }
  }
  if (!road.cut) return;
  if (!arm.in.empty()) network.approach_junctions.push_back(road.cut->junction);
  arms[road.cut->junction].push_back(arm);
}

void connect(LaneNetwork& network, int junction, int from, int to, Turn kind) {
  Lane lane;
  const Curve& in = network.lanes[from].curve;
  const Curve& out = network.lanes[to].curve;
  const std::optional<Ring>& ring = network.rings[junction];
  const CurvePoint start = in.at(in.length()), end = out.at(0);
  lane.curve = ring ? ring->way(start, end) : turn(start, end);
  lane.elevation_m = network.lanes[from].elevation_m;
  lane.width_m = ring ? ring->config.width_m : network.lanes[from].width_m;
  lane.junction = junction;
  lane.turn = kind;
  lane.next = {to};
  // A quarter turn of length L has the radius L / (pi / 2).
  if (ring)
    lane.speed_limit_m_s = std::sqrt(kLateralAcceleration * lane.curve.tightest_radius());
  else if (kind != Turn::kStraight)
    lane.speed_limit_m_s = std::sqrt(kLateralAcceleration * lane.curve.length() / (kPi / 2));
  network.lanes[from].next.push_back(static_cast<int>(network.lanes.size()));
  network.lanes.push_back(std::move(lane));
}

std::optional<Turn> turn_between(const Arm& from, const Arm& to) {
  if (from.in.empty() || to.out.empty()) return std::nullopt;
  if (&from == &to) return Turn::kStraight;
  const double angle = wrap_angle(to.heading - from.heading);
  const double turned = std::abs(angle);
  if (turned < kSharpestCrossing - kAngleSlack || turned > kPi - kSharpestCrossing + kAngleSlack)
    return std::nullopt;
  return angle > 0 ? Turn::kLeft : Turn::kRight;
}

/// Connects the arms of a junction. Left turns start on the inner lane, and right turns start on
/// the outer lane. Two vehicles cannot turn side by side. If a road ends at the junction, each of
/// its lanes therefore has a different turn.
void connect_arms(LaneNetwork& network, int index, const std::vector<Arm>& arms) {
  for (const Arm& from : arms) {
    for (const Arm& to : arms) {
      const auto kind = turn_between(from, to);
      if (kind == Turn::kStraight)
        for (std::size_t i = 0; i < from.in.size(); ++i)
          connect(network, index, from.in[i], to.out[i], Turn::kStraight);
      else if (kind == Turn::kLeft)
        connect(network, index, from.in.front(), to.out.front(), Turn::kLeft);
      else if (kind == Turn::kRight)
        connect(network, index, from.in.back(), to.out.back(), Turn::kRight);
    }
    const auto leads_nowhere = [&](int lane) { return network.lanes[lane].next.empty(); };
    if (const auto lanes = std::ranges::count_if(from.in, leads_nowhere))
      config::fail(network.junctions[index].place, "roads",
                   "expected a turn for each lane of a road that ends at the junction (one lane "
                   "turns left, one turns right), got lanes without a turn: " +
                       std::to_string(lanes));
  }
}

}  // namespace

LaneNetwork build_lane_network(const SceneConfig& scene, std::span<const Curve> centrelines) {
  std::vector<RoadLine> roads;
  for (std::size_t i = 0; i < scene.roads.size(); ++i) {
    const RoadConfig& road = scene.roads[i];
    for (const RoadLine& other : roads)
      if (other.config->name == road.name)
        config::fail(road.place, "name",
                     "expected each name once, got a second road '" + road.name + "'");
    roads.push_back({&road, centrelines[i], {}});
  }
  LaneNetwork network;
  for (std::size_t i = 0; i < scene.junctions.size(); ++i)
    network.rings.push_back(cut_roads(scene, static_cast<int>(i), roads));
  network.junctions = scene.junctions;
  for (const RoadLine& road : roads) network.cuts.push_back(road.cut);
  std::vector<std::vector<Arm>> arms(scene.junctions.size());
  for (const RoadLine& road : roads) {
    add_direction(network, road, road.curve, false, arms);
    if (!is_one_way(road.config->lanes))
      add_direction(network, road, road.curve.reversed(), true, arms);
  }
  for (std::size_t i = 0; i < arms.size(); ++i) connect_arms(network, static_cast<int>(i), arms[i]);
  return network;
}

}  // namespace infrasim
