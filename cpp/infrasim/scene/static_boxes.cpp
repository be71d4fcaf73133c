#include "infrasim/scene/static_boxes.h"

#include <algorithm>

#include "infrasim/config/fields.h"
#include "infrasim/core/numbers.h"
#include "infrasim/scene/vegetation.h"

namespace infrasim {

namespace {

constexpr double kLegWidth = 0.4;    // m, width of a gantry's leg
constexpr double kBeamHeight = 1.0;  // m, height of a gantry's beam
constexpr double kLegGap = 0.5;      // m, distance from the carriageway to a gantry's leg

}  // namespace

std::vector<StaticBox> static_boxes(const SceneConfig& scene, std::span<const Curve> centrelines) {
  std::vector<StaticBox> out;
  for (const BuildingConfig& b : scene.buildings)
    out.push_back({{b.x_m, b.y_m, b.base_m + b.height_m / 2, b.length_m, b.width_m, b.height_m,
                    rad(b.heading_deg)},
                   b.place,
                   "x_m",
                   "a building"});
  for (const GantryConfig& g : scene.gantries) {
    const auto [road, curve] = road_named(scene, centrelines, g.road, g.place);
    if (g.s_m > curve.length())
      config::fail(g.place, "s_m",
                   "expected at most the length of the road, " + fixed_text(curve.length(), 2) +
                       " m, got " + config::number_text(g.s_m));
    const CurvePoint foot = curve.at(g.s_m);
    const double leg = carriageway_half_width(road.lanes) + kLegGap;
    const double z = road.elevation_m;
    const auto add = [&](double left, double base, double width, double height) {
      const Vec2 p = foot.position + left * heading_vector(foot.heading + kPi / 2);
      out.push_back({{p.x, p.y, base + height / 2, kLegWidth, width, height, foot.heading},
                     g.place,
                     "s_m",
                     "a gantry"});
    };
    for (const double side : {leg, -leg}) add(side, z, kLegWidth, g.clearance_m);
    add(0, z + g.clearance_m, 2 * leg + kLegWidth, kBeamHeight);
  }
  const std::vector<StaticBox> trees = trunks(scene, centrelines);
  out.insert(out.end(), trees.begin(), trees.end());
  return out;
}

std::vector<Box3d> barrier_pieces(const Road& road, const BarrierConfig& barrier,
                                  double longest_m) {
  const Curve& line = road.centreline;
  const double to = end_of(line, barrier);
  std::vector<Box3d> out;
  for (double s = barrier.from_m; s < to; s += longest_m) {
    const double length = std::min(longest_m, to - s);
    const CurvePoint p = line.at(s + length / 2);
    const Vec2 centre = p.position + barrier.offset_m * heading_vector(p.heading + kPi / 2);
    out.push_back({centre.x, centre.y, road.config.elevation_m + barrier.height_m / 2, length,
                   barrier.width_m, barrier.height_m, p.heading});
  }
  return out;
}

}  // namespace infrasim
