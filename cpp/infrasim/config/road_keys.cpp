#include "infrasim/config/scene_keys.h"

namespace infrasim {

using config::at_least_one;
using config::between;
using config::required;

template <class Fields>
void visit(Fields& f, CentrelinePiece& c) {
  f.field("line_m", c.line_m, "length of a straight piece", between(0, 1e5));
  f.field("radius_m", c.radius_m, "radius of an arc", between(0, 1e5));
  f.field("turn_deg", c.turn_deg, "angle of an arc, positive to the left", between(-360, 360));
  const bool line = c.line_m > 0 && c.radius_m == 0 && c.turn_deg == 0;
  const bool arc = c.line_m == 0 && c.radius_m > 0 && c.turn_deg != 0;
  f.check(line || arc, "line_m", "expected line_m, or radius_m with turn_deg, got neither");
}

template <class Fields>
void visit(Fields& f, RoadStart& c) {
  f.field("x_m", c.x_m, "world x of the first point", required());
  f.field("y_m", c.y_m, "world y of the first point", required());
  f.field("heading_deg", c.heading_deg, "direction at the first point", between(-360, 360));
}

template <class Fields>
void visit(Fields& f, LanesConfig& c) {
  f.field("each_way", c.each_way,
          "number of lanes on each side of the centreline; on a one-way road, number of all lanes",
          required(between(1, 8)));
  f.field("one_way", c.one_way, "whether all traffic moves in the direction of the centreline");
  f.field("width_m", c.width_m, "width of a lane", between(2.5, 6));
  f.field("median_m", c.median_m, "strip between the two directions", between(0, 50));
  f.field("shoulder_m", c.shoulder_m, "strip outside the lanes", between(0, 20));
  f.field("sidewalk_m", c.sidewalk_m, "footway outside the shoulder", between(0, 20));
  f.check(!c.one_way.value_or(false) || c.median_m == 0, "median_m",
          "expected 0 on a one-way road, got a median");
}

template <class Fields>
void visit(Fields& f, EmbankmentConfig& c) {
  f.field("run_per_rise", c.run_per_rise, "horizontal length of the slope per metre of height",
          between(0, 20));
  f.field("foot_elevation_m", c.foot_elevation_m, "world z of the foot of the slope", required());
}

template <class Fields>
void visit(Fields& f, RoadConfig& c) {
  f.here(c.place);
  f.field("name", c.name, "name of the road", required());
  f.field("start", c.start, "first point of the centreline", required());
  f.field("centreline", c.centreline, "straight pieces and arcs in order", at_least_one());
  f.field("elevation_m", c.elevation_m, "world z of the road", between(-1e3, 1e4));
  f.field("lanes", c.lanes, "cross-section of the road", required());
  f.field("embankment", c.embankment, "slopes from both edges of the road down to the terrain");
  check_name(f, c.name);
  const LanesConfig& l = c.lanes;
  const double half = lanes_half_width(l) + l.shoulder_m + l.sidewalk_m;
  for (const CentrelinePiece& piece : c.centreline)
    f.check(piece.radius_m == 0 || piece.radius_m > half, "centreline",
            "expected a radius_m above half the road's width, " + config::number_text(half) +
                " m, got a radius_m of " + config::number_text(piece.radius_m));
}

template <class Fields>
void visit(Fields& f, ProfileConfig& c) {
  f.field("x_m", c.x_m, "world x of station 0", between(-1e6, 1e6));
  f.field("y_m", c.y_m, "world y of station 0", between(-1e6, 1e6));
  f.field("heading_deg", c.heading_deg, "direction in which stations increase", between(-360, 360));
  f.field("points_m", c.points_m,
          "station and elevation of each change of grade; beyond the first and the last point, the "
          "profile is level",
          required(between(-1e5, 1e5)));
  f.field("vertical_curve_m", c.vertical_curve_m,
          "length of the vertical curve at each change of grade", between(1, 1e3));
  f.check(c.points_m.size() >= 2, "points_m", "expected 2 or more points, got fewer");
  for (std::size_t i = 1; i < c.points_m.size(); ++i) {
    const Vec2 step = c.points_m[i] - c.points_m[i - 1];
    f.check(step.x >= c.vertical_curve_m, "points_m",
            "expected points at least vertical_curve_m (" +
                config::number_text(c.vertical_curve_m) + " m) apart, got a point " +
                config::number_text(step.x) + " m after the one before");
    f.check(std::abs(step.y) <= kSteepest * step.x + 1e-9, "points_m",
            "expected grades of up to " + config::number_text(100 * kSteepest) +
                " %, got a grade of " +
                config::number_text(std::round(1e6 * step.y / step.x) / 1e4) + " %");
  }
}

template <class Fields>
void visit(Fields& f, SignalConfig& c) {
  f.field("green_s", c.green_s, "green time of each approach", between(5, 200));
  f.field("all_red_s", c.all_red_s, "shortest time between the green phases of two approaches",
          between(1, 30));
}

template <class Fields>
void visit(Fields& f, RoundaboutConfig& c) {
  f.field("radius_m", c.radius_m, "radius of the middle of its lane", between(12, 60));
  f.field("width_m", c.width_m, "width of its lane", between(4, 8));
  f.field("island_m", c.island_m, "height of the island above the road", between(0.05, 3));
}

template <class Fields>
void visit(Fields& f, JunctionConfig& c) {
  f.here(c.place);
  f.field("roads", c.roads, "names of the two roads that cross", required());
  f.field("signal", c.signal, "signal timing");
  f.field("roundabout", c.roundabout, "roundabout, which replaces the crossing and its signals");
  f.field("left_share", c.left_share, "share of the vehicles that turn left", between(0, 0.5));
  f.field("right_share", c.right_share, "share of the vehicles that turn right", between(0, 0.5));
  f.check(c.roads.size() == 2, "roads", "expected 2 names, got " + std::to_string(c.roads.size()));
  f.check(!(c.signal && c.roundabout), "signal", "expected a signal or a roundabout, got both");
}

template <class Fields>
void visit_ways(Fields& f, SceneConfig& c) {
  f.field("lanes", c.lanes,
          "file of lanes with elevations, which replaces roads; lanes have no surface");
  f.here(c.lanes_key, "lanes");
  f.field("roads", c.roads, "roads; not used with lanes",
          c.lanes ? config::Rule{} : at_least_one());
  f.check(!c.lanes || c.roads.empty(), "roads", "expected roads or lanes, got both");
  f.field(
      "profile", c.profile,
      "elevation profile along one direction; it raises roads, terrain and the objects on them");
}

template <class Fields>
void visit_junctions(Fields& f, SceneConfig& c) {
  f.field("junctions", c.junctions, "junctions of two roads");
}

template void visit_ways(config::FieldReader&, SceneConfig&);
template void visit_ways(config::FieldWriter&, SceneConfig&);
template void visit_ways(config::FieldLister&, SceneConfig&);
template void visit_junctions(config::FieldReader&, SceneConfig&);
template void visit_junctions(config::FieldWriter&, SceneConfig&);
template void visit_junctions(config::FieldLister&, SceneConfig&);

}  // namespace infrasim
