#include "infrasim/scene/roads.h"

#include <algorithm>

#include "infrasim/config/fields.h"
#include "infrasim/config/lidar_config.h"

namespace infrasim {

namespace {

constexpr double kMostRoad =
    100'000;  // m, maximum total length; longer roads only cost time, because rays end at 5 km

/// Returns the length of an arc's chords. The length is 0.5 m for radii up to 40 m. The chords of
/// larger arcs deviate from the arc by at most 0.8 mm.
double arc_step(double radius) { return 0.5 * std::sqrt(std::max(1.0, radius / 40)); }

void append_line(std::vector<CurvePoint>& samples, double length) {
  const CurvePoint from = samples.back();
  samples.push_back({from.position + length * heading_vector(from.heading), from.heading});
}

void append_arc(std::vector<CurvePoint>& samples, double radius, double angle) {
  const CurvePoint from = samples.back();
  const double side = angle > 0 ? 1 : -1;
  const Vec2 centre = from.position + side * radius * heading_vector(from.heading + kPi / 2);
  const int steps =
      std::max(1, static_cast<int>(std::ceil(std::abs(angle) * radius / arc_step(radius))));
  for (int i = 1; i <= steps; ++i) {
    const double heading = from.heading + angle * i / steps;
    samples.push_back({centre - side * radius * heading_vector(heading + kPi / 2), heading});
  }
}

}  // namespace

double carriageway_half_width(const LanesConfig& lanes) {
  return lanes_half_width(lanes) + lanes.shoulder_m;
}

double outer_half_width(const LanesConfig& lanes) {
  return carriageway_half_width(lanes) + lanes.sidewalk_m;
}

Curve centreline(const RoadConfig& road) {
  std::vector<CurvePoint> samples{{{road.start.x_m, road.start.y_m}, rad(road.start.heading_deg)}};
  for (const CentrelinePiece& piece : road.centreline) {
    if (piece.line_m > 0)
      append_line(samples, piece.line_m);
    else
      append_arc(samples, piece.radius_m, rad(piece.turn_deg));
  }
  return Curve(std::move(samples));
}

std::vector<Curve> centrelines(const SceneConfig& scene) {
  std::vector<Curve> out;
  double length = 0;
  for (const RoadConfig& road : scene.roads) {
    for (const CentrelinePiece& piece : road.centreline)
      length += piece.line_m + piece.radius_m * rad(std::abs(piece.turn_deg));
    if (length > kMostRoad)
      config::fail(road.place, "centreline",
                   "expected up to " + config::number_text(kMostRoad) + " m of roads, got " +
                       config::number_text(std::round(length)) +
                       " m up to this road; rays end at " + config::number_text(kLongestRange_m) +
                       " m");
    out.push_back(centreline(road));
  }
  return out;
}

Road road_named(const SceneConfig& scene, std::span<const Curve> centrelines,
                const std::string& name, const config::Place& place) {
  const std::size_t i = road_index(scene, name, place, "road");
  return {scene.roads[i], centrelines[i]};
}

}  // namespace infrasim
