#include "infrasim/scene/lane_network.h"

#include <algorithm>

#include "infrasim/config/fields.h"

namespace infrasim {

double lanes_half_width(const LanesConfig& lanes) {
  return lanes.median_m / 2 + lanes.each_way * lanes.width_m;
}

double carriageway_half_width(const LanesConfig& lanes) {
  return lanes_half_width(lanes) + lanes.shoulder_m;
}

double outer_half_width(const LanesConfig& lanes) {
  return carriageway_half_width(lanes) + lanes.sidewalk_m;
}

namespace {

constexpr double kStopLineGap = 3;             // between the crossing road's edge and the stop line
constexpr double kLateralAcceleration = 2;     // m/s2 that drivers accept in a turn
constexpr double kSharpestCrossing = kPi / 4;  // between two roads: a sharper turn is none
constexpr double kMostBend = kPi / 6;          // of a road within its junction

/// One direction of a road at a junction: lane indices, inner lane first.
struct Arm {
  double heading = 0;
  std::vector<int> in;
  std::vector<int> out;
};

struct RoadLine {
  const RoadConfig* config = nullptr;
  Curve curve;
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

/// Half the length that a crossing road's width, footways included, takes of a road.
double half_crossing(const LanesConfig& own, const LanesConfig& other, double angle) {
  const double across = outer_half_width(other);
  const double along = carriageway_half_width(own) * std::abs(std::cos(angle));
  return (across + along) / std::abs(std::sin(angle));
}

/// Angle between two lines, from 0 to a right one.
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
                 "found '" + a.name + "' at " + config::number_text(a.elevation_m) + " m and '" +
                     b.name + "' at " + config::number_text(b.elevation_m) +
                     " m, allowed roads at one height");
}

/// Straight on is nearly straight, and every other way out is a turn to the left or right.
void check_angles(const JunctionConfig& junction, const RoadLine& a, const RoadLine& b) {
  for (const RoadLine* road : {&a, &b}) {
    const double in = road->curve.at(road->cut->from).heading;
    const double bend = std::abs(wrap_angle(road->curve.at(road->cut->to).heading - in));
    if (bend > kMostBend)
      config::fail(junction.place, "roads",
                   "found '" + road->config->name + "' to bend by " + degrees_text(bend) +
                       " in it, allowed up to " + degrees_text(kMostBend));
  }
  for (const double s : {a.cut->from, a.cut->to})
    for (const double t : {b.cut->from, b.cut->to}) {
      const double angle = between_lines(a.curve.at(s).heading, b.curve.at(t).heading);
      if (angle <= kSharpestCrossing)
        config::fail(junction.place, "roads",
                     "found arms at " + degrees_text(angle) + " to each other, allowed above " +
                         degrees_text(kSharpestCrossing));
    }
}

void cut_roads(const SceneConfig& scene, int index, std::vector<RoadLine>& roads) {
  const JunctionConfig& junction = scene.junctions[static_cast<std::size_t>(index)];
  RoadLine& a = roads[road_index(scene, junction.roads[0], junction.place, "roads")];
  RoadLine& b = roads[road_index(scene, junction.roads[1], junction.place, "roads")];
  const auto point = crossing(a.curve, b.curve);
  if (&a == &b || !point)
    config::fail(junction.place, "roads", "found roads that do not cross, allowed two that do");
  check_heights(junction, *a.config, *b.config);
  const std::array stations{a.curve.project(*point), b.curve.project(*point)};
  const double angle =
      between_lines(a.curve.at(stations[0]).heading, b.curve.at(stations[1]).heading);
  for (auto* road : {&a, &b}) {
    const LanesConfig& other = (road == &a ? b : a).config->lanes;
    const double half =
        half_crossing(road->config->lanes, other, std::max(angle, kSharpestCrossing)) +
        kStopLineGap;
    const double s = stations[road == &a ? 0 : 1];
    if (road->cut)
      config::fail(junction.place, "roads", "found a second junction on a road, allowed one");
    if (s < half + 10 || s > road->curve.length() - half - 10)
      config::fail(junction.place, "roads",
                   "found a junction within 10 m of a road's end, allowed further in");
    road->cut = JunctionCut{index, s - half, s + half};
  }
  check_angles(junction, a, b);
}

int add_lane(LaneNetwork& network, const RoadConfig& road, Curve curve) {
  Lane lane;
  lane.curve = std::move(curve);
  lane.elevation_m = road.elevation_m;
  lane.width_m = road.lanes.width_m;
  network.lanes.push_back(std::move(lane));
  return static_cast<int>(network.lanes.size()) - 1;
}

/// Lanes of one direction of a road; `along` runs with the traffic.
void add_direction(LaneNetwork& network, const RoadLine& road, const Curve& along, bool reversed,
                   std::vector<std::vector<Arm>>& arms) {
  const LanesConfig& cross_section = road.config->lanes;
  Arm arm;
  double stop = 0, resume = 0;
  if (road.cut) {
    stop = reversed ? along.length() - road.cut->to : road.cut->from;
    resume = reversed ? along.length() - road.cut->from : road.cut->to;
    arm.heading = along.at(stop).heading;
  }
  for (int i = 0; i < cross_section.each_way; ++i) {
    const double right = cross_section.median_m / 2 + (i + 0.5) * cross_section.width_m;
    const auto lane_curve = [&](double s0, double s1) { return along.part(s0, s1).offset(-right); };
    if (!road.cut) {
      network.lanes[add_lane(network, *road.config, lane_curve(0, along.length()))].entry = true;
      continue;
    }
    arm.in.push_back(add_lane(network, *road.config, lane_curve(0, stop)));
    network.lanes[arm.in.back()].entry = true;
    network.lanes[arm.in.back()].approach = static_cast<int>(network.approach_junctions.size());
    arm.out.push_back(add_lane(network, *road.config, lane_curve(resume, along.length())));
  }
  if (!road.cut) return;
  network.approach_junctions.push_back(road.cut->junction);
  arms[road.cut->junction].push_back(arm);
}

void connect(LaneNetwork& network, int junction, int from, int to, Turn kind) {
  Lane lane;
  const Curve& in = network.lanes[from].curve;
  const Curve& out = network.lanes[to].curve;
  lane.curve = turn(in.at(in.length()), out.at(0));
  lane.elevation_m = network.lanes[from].elevation_m;
  lane.width_m = network.lanes[from].width_m;
  lane.junction = junction;
  lane.turn = kind;
  lane.next = {to};
  // A quarter turn over a chord c has radius c / sqrt(2).
  if (kind != Turn::kStraight)
    lane.speed_limit_m_s = std::sqrt(kLateralAcceleration * lane.curve.length() / (kPi / 2));
  network.lanes[from].next.push_back(static_cast<int>(network.lanes.size()));
  network.lanes.push_back(std::move(lane));
}

void connect_arms(LaneNetwork& network, int junction, const std::vector<Arm>& arms) {
  for (const Arm& from : arms)
    for (const Arm& to : arms) {
      const double angle = wrap_angle(to.heading - from.heading);
      if (&from == &to) {
        for (std::size_t i = 0; i < from.in.size(); ++i)
          connect(network, junction, from.in[i], to.out[i], Turn::kStraight);
      } else if (angle > kPi / 4 && angle < 3 * kPi / 4) {
        connect(network, junction, from.in.front(), to.out.front(), Turn::kLeft);
      } else if (angle < -kPi / 4 && angle > -3 * kPi / 4) {
        connect(network, junction, from.in.back(), to.out.back(), Turn::kRight);
      }
    }
}

}  // namespace

LaneNetwork build_lane_network(const SceneConfig& scene) {
  std::vector<RoadLine> roads;
  for (const RoadConfig& road : scene.roads) {
    for (const RoadLine& other : roads)
      if (other.config->name == road.name)
        config::fail(road.place, "name", "found a second road '" + road.name + "', allowed one");
    roads.push_back({&road, centreline(road), {}});
  }
  for (std::size_t i = 0; i < scene.junctions.size(); ++i)
    cut_roads(scene, static_cast<int>(i), roads);

  LaneNetwork network;
  network.junctions = scene.junctions;
  for (const RoadLine& road : roads) network.cuts.push_back(road.cut);
  std::vector<std::vector<Arm>> arms(scene.junctions.size());
  for (const RoadLine& road : roads) {
    add_direction(network, road, road.curve, false, arms);
    add_direction(network, road, road.curve.reversed(), true, arms);
  }
  for (std::size_t i = 0; i < arms.size(); ++i) connect_arms(network, static_cast<int>(i), arms[i]);
  return network;
}

}  // namespace infrasim
