#include "infrasim/config/scene_config.h"

#include <set>

#include "infrasim/config/fields.h"
#include "infrasim/config/filter_declarations.h"
#include "infrasim/config/key_list.h"
#include "infrasim/core/classes.h"

namespace infrasim {

using config::at_least_one;
using config::between;
using config::positive;
using config::required;

std::span<const char* const> enum_names(Detail) {
  static constexpr std::array kNames{"box", "low", "mid", "fine"};
  return kNames;
}

std::span<const char* const> enum_names(LabelRule) {
  static constexpr std::array kNames{"hit", "all"};
  return kNames;
}

std::span<const char* const> enum_names(LabelTime) {
  static constexpr std::array kNames{"frame", "scan"};
  return kNames;
}

std::span<const char* const> enum_names(Material) {
  static constexpr std::array kNames{"road", "sidewalk", "terrain", "structure", "vegetation"};
  return kNames;
}

std::span<const char* const> enum_names(PersonKind) {
  static constexpr std::array kNames{"Pedestrian", "Cyclist"};
  return kNames;
}

LabelTime label_time_of(const SceneConfig& scene, const std::string& preset) {
  const bool study = preset == "paper" || preset == "equal";
  return scene.label_time.value_or(study ? LabelTime::kFrame : LabelTime::kScan);
}

template <class Fields>
void visit(Fields& f, CentrelinePiece& c) {
  f.field("line_m", c.line_m, "length of a straight piece", between(0, 1e5));
  f.field("radius_m", c.radius_m, "radius of an arc", between(0, 1e5));
  f.field("turn_deg", c.turn_deg, "angle of an arc, positive to the left", between(-360, 360));
  const bool line = c.line_m > 0 && c.radius_m == 0 && c.turn_deg == 0;
  const bool arc = c.line_m == 0 && c.radius_m > 0 && c.turn_deg != 0;
  f.check(line || arc, "line_m", "found neither, allowed line_m, or radius_m with turn_deg");
}

template <class Fields>
void visit(Fields& f, RoadStart& c) {
  f.field("x_m", c.x_m, "world x of the first point", required());
  f.field("y_m", c.y_m, "world y of the first point", required());
  f.field("heading_deg", c.heading_deg, "direction at the first point", between(-360, 360));
}

template <class Fields>
void visit(Fields& f, LanesConfig& c) {
  f.field("each_way", c.each_way, "lanes on each side of the centreline; of a one-way road all",
          required(between(1, 8)));
  f.field("one_way", c.one_way, "traffic in the direction of the centreline alone");
  f.field("width_m", c.width_m, "width of a lane", between(2.5, 6));
  f.field("median_m", c.median_m, "strip between the two directions", between(0, 50));
  f.field("shoulder_m", c.shoulder_m, "strip outside the lanes", between(0, 20));
  f.field("sidewalk_m", c.sidewalk_m, "footway outside the shoulder", between(0, 20));
  f.check(!c.one_way.value_or(false) || c.median_m == 0, "median_m",
          "found a median of a one-way road, allowed 0");
}

template <class Fields>
void visit(Fields& f, EmbankmentConfig& c) {
  f.field("run_per_rise", c.run_per_rise, "horizontal length of the slope per metre of height",
          between(0, 20));
  f.field("foot_elevation_m", c.foot_elevation_m, "where the slope ends", required());
}

/// Of what tables name.
template <class Fields>
void check_name(Fields& f, const std::string& name) {
  f.check(name.find(',') == std::string::npos && name.size() <= 100, "name",
          "found a comma or more than 100 letters, allowed a short name");
  f.check(config::begins_as_name(name), "name",
          "found '" + name + "', allowed a name that begins with a letter, a digit or _");
}

template <class Fields>
void visit(Fields& f, RoadConfig& c) {
  f.here(c.place);
  f.field("name", c.name, "name of the road", required());
  f.field("start", c.start, "first point of the centreline", required());
  f.field("centreline", c.centreline, "lines and arcs, end to end", at_least_one());
  f.field("elevation_m", c.elevation_m, "world z of the road", between(-1e3, 1e4));
  f.field("lanes", c.lanes, "cross-section", required());
  f.field("embankment", c.embankment, "slopes down from both edges");
  check_name(f, c.name);
  const LanesConfig& l = c.lanes;
  const double half = lanes_half_width(l) + l.shoulder_m + l.sidewalk_m;
  for (const CentrelinePiece& piece : c.centreline)
    f.check(piece.radius_m == 0 || piece.radius_m > half, "centreline",
            "found a radius_m of " + config::number_text(piece.radius_m) +
                ", allowed above half the road's width, " + config::number_text(half));
}

template <class Fields>
void visit(Fields& f, ProfileConfig& c) {
  f.here(c.place);
  f.field("x_m", c.x_m, "world x where stations begin", between(-1e6, 1e6));
  f.field("y_m", c.y_m, "world y where stations begin", between(-1e6, 1e6));
  f.field("heading_deg", c.heading_deg, "direction that stations run in", between(-360, 360));
  f.field("points_m", c.points_m, "station and rise of each change of grade; level beyond",
          required(between(-1e5, 1e5)));
  f.field("vertical_curve_m", c.vertical_curve_m,
          "length of the parabola that rounds each change of grade", between(1, 1e3));
  f.check(c.points_m.size() >= 2, "points_m", "found fewer than 2 points, allowed 2 or more");
  for (std::size_t i = 1; i < c.points_m.size(); ++i) {
    const Vec2 step = c.points_m[i] - c.points_m[i - 1];
    f.check(step.x >= c.vertical_curve_m, "points_m",
            "found a point " + config::number_text(step.x) +
                " m after the one before, allowed from vertical_curve_m, " +
                config::number_text(c.vertical_curve_m) + ", on");
    f.check(std::abs(step.y) <= kSteepest * step.x, "points_m",
            "found a grade of " + config::number_text(std::round(1e4 * step.y / step.x) / 100) +
                " %, allowed up to " + config::number_text(100 * kSteepest));
  }
}

template <class Fields>
void visit(Fields& f, GroundConfig& c) {
  f.here(c.place);
  f.field("elevation_m", c.elevation_m, "world z of the terrain", required(between(-1e3, 1e4)));
  f.field("outline_m", c.outline_m, "convex outline, counter-clockwise", required());
  f.check(c.outline_m.size() >= 3, "outline_m", "found fewer than 3 corners");
  double turned = 0;
  bool left = true;
  for (std::size_t i = 0, n = c.outline_m.size(); i < n; ++i) {
    const Vec2 a = c.outline_m[i], b = c.outline_m[(i + 1) % n], d = c.outline_m[(i + 2) % n];
    left = left && cross(b - a, d - b) > 0;
    turned += std::atan2(cross(b - a, d - b), dot(b - a, d - b));
  }
  f.check(left && turned < 3 * kPi, "outline_m",
          "found corners that do not turn left once round, allowed a convex outline, "
          "counter-clockwise");
}

template <class Fields>
void visit(Fields& f, MeshConfig& c) {
  f.here(c.place);
  f.field("file", c.file, ".ply in world coordinates, relative to the scene file", required());
  f.field("material", c.material, "what its surface is of; glass is not there yet", required());
}

template <class Fields>
void visit(Fields& f, BuildingConfig& c) {
  f.here(c.place);
  f.field("x_m", c.x_m, "world x of the centre", required());
  f.field("y_m", c.y_m, "world y of the centre", required());
  f.field("length_m", c.length_m, "size along its heading", required(positive(2000)));
  f.field("width_m", c.width_m, "size across its heading", required(positive(2000)));
  f.field("height_m", c.height_m, "height above its base", required(positive(1000)));
  f.field("heading_deg", c.heading_deg, "direction of its length", between(-360, 360));
  f.field("base_m", c.base_m, "world z of its base", between(-1e3, 1e4));
}

/// Beside which road something stands.
template <class Fields, class Config>
void visit_side(Fields& f, Config& c, const char* road = "name of its road") {
  f.field("road", c.road, road, required());
  f.field("offset_m", c.offset_m, "to the left of the centreline", required(between(-100, 100)));
}

/// From where to where along its road.
template <class Fields, class Config>
void visit_stations(Fields& f, Config& c, const char* from = "first station of the centreline") {
  f.field("from_m", c.from_m, from, between(0, 1e5));
  f.field("to_m", c.to_m, "last station, at most the road's end", between(0, 1e9));
}

template <class Fields>
void visit(Fields& f, BarrierConfig& c) {
  f.here(c.place);
  visit_side(f, c);
  f.field("height_m", c.height_m, "height above the road", positive(20));
  f.field("width_m", c.width_m, "thickness", positive(10));
  visit_stations(f, c);
}

template <class Fields>
void visit(Fields& f, GantryConfig& c) {
  f.here(c.place);
  f.field("road", c.road, "name of its road", required());
  f.field("s_m", c.s_m, "station of the centreline", required(between(0, 1e5)));
  f.field("clearance_m", c.clearance_m, "free height above the road", between(kClearance_m, 30));
}

template <class Fields>
void visit_density(Fields& f, double& density_per_m) {
  f.field("density_per_m", density_per_m, "chance per metre that leaves stop a ray", positive(100));
}

template <class Fields>
void visit(Fields& f, HedgeConfig& c) {
  f.here(c.place);
  f.field("x_m", c.x_m, "world x of the centre", required());
  f.field("y_m", c.y_m, "world y of the centre", required());
  f.field("length_m", c.length_m, "size along its heading", required(positive(2000)));
  f.field("width_m", c.width_m, "size across its heading", positive(2000));
  f.field("height_m", c.height_m, "height above its base", positive(100));
  f.field("heading_deg", c.heading_deg, "direction of its length", between(-360, 360));
  f.field("base_m", c.base_m, "world z of its base", between(-1e3, 1e4));
  visit_density(f, c.density_per_m);
}

template <class Fields>
void visit(Fields& f, HedgeAlongConfig& c) {
  f.here(c.place);
  visit_side(f, c);
  f.field("height_m", c.height_m, "height above its base", positive(100));
  f.field("width_m", c.width_m, "thickness", positive(100));
  f.field("base_m", c.base_m, "its base above the road", between(-100, 100));
  visit_stations(f, c);
  visit_density(f, c.density_per_m);
}

template <class Fields>
void visit_shape(Fields& f, TreeShape& c, const char* base) {
  f.field("height_m", c.height_m, "of the crown's top above the base", positive(100));
  f.field("crown_m", c.crown_m, "width of the crown", positive(50));
  f.field("trunk_m", c.trunk_m, "height of the crown's lowest leaves", between(0, 100));
  f.field("trunk_width_m", c.trunk_width_m, "thickness of the trunk", positive(5));
  f.field("base_m", c.base_m, base, between(-1e3, 1e4));
  visit_density(f, c.density_per_m);
  f.check(c.height_m > c.trunk_m, "height_m", "found it not above trunk_m, allowed above");
}

template <class Fields>
void visit(Fields& f, TreeConfig& c) {
  f.here(c.place);
  f.field("x_m", c.x_m, "world x of the trunk", required());
  f.field("y_m", c.y_m, "world y of the trunk", required());
  visit_shape(f, c.shape, "world z of its base");
}

template <class Fields>
void visit(Fields& f, TreesAlongConfig& c) {
  f.here(c.place);
  visit_side(f, c, "name of their road");
  f.field("every_m", c.every_m, "from one to the next", between(1, 1e5));
  visit_stations(f, c, "station of the first");
  visit_shape(f, c.shape, "their base above the road");
}

template <class Fields>
void visit(Fields& f, VegetationConfig& c) {
  f.field("hedge", c.hedge, "upright box of leaves");
  f.field("hedge_along", c.hedge_along, "hedge along a road");
  f.field("tree", c.tree, "ellipsoid of leaves on a solid trunk");
  f.field("trees_along", c.trees_along, "row of trees along a road");
  const int kinds = c.hedge.has_value() + c.hedge_along.has_value() + c.tree.has_value() +
                    c.trees_along.has_value();
  f.check(kinds == 1, "hedge",
          "found none or several, allowed one of hedge, hedge_along, tree, trees_along");
}

template <class Fields>
void visit(Fields& f, SignalConfig& c) {
  f.field("green_s", c.green_s, "green of each approach", between(5, 200));
  f.field("all_red_s", c.all_red_s, "shortest pause between two greens", between(1, 30));
}

template <class Fields>
void visit(Fields& f, RoundaboutConfig& c) {
  f.field("radius_m", c.radius_m, "to the middle of its lane", between(12, 60));
  f.field("width_m", c.width_m, "of its lane", between(4, 8));
  f.field("island_m", c.island_m, "height of the island above the road", between(0.05, 3));
}

template <class Fields>
void visit(Fields& f, JunctionConfig& c) {
  f.here(c.place);
  f.field("roads", c.roads, "names of the two roads that cross", required());
  f.field("signal", c.signal, "signal timing");
  f.field("roundabout", c.roundabout, "ring in place of the crossing and its signals");
  f.field("left_share", c.left_share, "share that turns left", between(0, 0.5));
  f.field("right_share", c.right_share, "share that turns right", between(0, 0.5));
  f.check(c.roads.size() == 2, "roads",
          "found " + std::to_string(c.roads.size()) + " names, allowed 2");
  f.check(!(c.signal && c.roundabout), "signal",
          "found it beside a roundabout, allowed one of both");
}

template <class Fields>
void visit(Fields& f, SpeedConfig& c) {
  f.field("mean_km_h", c.mean_km_h, "desired speed", required(positive(200)));
  f.field("std_km_h", c.std_km_h, "its standard deviation", between(0, 50));
}

/// Classes of vehicles by weight; `why_not` says what keeps the others out.
template <class Fields>
void visit_shares(Fields& f, std::map<std::string, double>& shares, const std::string& why_not) {
  f.field("class_shares", shares, "weight of each object class", [] {
    auto rule = at_least_one();
    rule.min = 0;
    rule.max = 1;
    return rule;
  }());
  double sum = 0;
  for (const auto& [name, share] : shares) {
    const ObjectClass* object_class = find_class(name);
    f.check(object_class != nullptr, "class_shares",
            "found unknown class '" + name + "', allowed Car, Van, Truck, Bus, Motorcycle");
    f.check(object_class == nullptr || object_class->vehicle || share == 0, "class_shares",
            std::string("found ")
                .append(name)
                .append(", which ")
                .append(why_not)
                .append(", allowed Car, Van, Truck, Bus, Motorcycle; trajectories may have all"));
    sum += share;
  }
  f.check(sum > 0, "class_shares", "found a sum of 0, allowed above 0");
}

template <class Fields>
void visit(Fields& f, TrafficConfig& c) {
  f.here(c.place);
  f.field("vehicles_per_km_lane", c.vehicles_per_km_lane, "density", required(between(0, 100)));
  f.field("speed", c.speed, "desired speeds", required());
  f.field("warm_up_s", c.warm_up_s, "driven before frame 0", between(0, 1e4));
  visit_shares(f, c.class_shares, "has no speed and way of its own in traffic");
  double sum = 0, sum_of_lengths = 0;
  for (const auto& [name, share] : c.class_shares) {
    sum += share;
    if (const ObjectClass* object_class = find_class(name))
      sum_of_lengths += share * object_class->length_m.mean;
  }
  const double most = std::floor(1000 / (sum_of_lengths / sum + kStandstillGap_m));
  f.check(!(c.vehicles_per_km_lane > most), "vehicles_per_km_lane",
          "found " + config::number_text(c.vehicles_per_km_lane) + ", allowed up to " +
              config::number_text(most) + ", vehicles of these classes with " +
              config::number_text(kStandstillGap_m) + " m between them");
}

template <class Fields>
void visit(Fields& f, ParkedConfig& c) {
  f.here(c.place);
  visit_side(f, c);
  visit_stations(f, c);
  f.field("turn_deg", c.turn_deg, "of the vehicles from the road's direction", between(-90, 90));
  f.field("gap_m", c.gap_m, "mean of the gaps between two", between(0.2, 1000));
  f.field("occupied", c.occupied, "share of the places that a vehicle stands in", between(0, 1));
  f.field("base_m", c.base_m, "their base above the road", between(-100, 100));
  visit_shares(f, c.class_shares, "is no vehicle");
}

template <class Fields>
void visit(Fields& f, PersonSpeedConfig& c) {
  f.field("mean_km_h", c.mean_km_h, "mean of their own speeds", required(between(1, 50)));
  f.field("std_km_h", c.std_km_h, "its standard deviation, at most a third of the mean",
          required(between(0, 20)));
  f.check(!(3 * c.std_km_h > c.mean_km_h), "std_km_h",
          "found " + config::number_text(c.std_km_h) +
              ", allowed up to a third of mean_km_h, so that everybody moves");
}

template <class Fields>
void visit(Fields& f, PeopleConfig& c) {
  f.here(c.place);
  visit_side(f, c);
  visit_stations(f, c);
  f.field("per_km", c.per_km, "how many on a kilometre of the line, both ways together",
          required(between(0, 60)));
  f.field("class", c.kind, "on foot or on bicycles", required());
  f.field("speed", c.speed, "constant, everybody's own", required());
}

template <class Fields>
void visit(Fields& f, CalibrationError& c) {
  f.field("x_m", c.x_m, "of x_m", between(-10, 10));
  f.field("y_m", c.y_m, "of y_m", between(-10, 10));
  f.field("z_m", c.z_m, "of z_m", between(-10, 10));
  f.field("yaw_deg", c.yaw_deg, "of yaw_deg", between(-180, 180));
  f.field("pitch_deg", c.pitch_deg, "of pitch_deg", between(-90, 90));
  f.field("roll_deg", c.roll_deg, "of roll_deg", between(-180, 180));
}

template <class Fields>
void visit(Fields& f, MountConfig& c) {
  f.here(c.place);
  f.field("x_m", c.x_m, "world x", required());
  f.field("y_m", c.y_m, "world y", required());
  f.field("z_m", c.z_m, "world z", required(between(-1e3, 1e4)));
  f.field("yaw_deg", c.yaw_deg, "view direction, from +x towards +y", between(-360, 360));
  f.field("pitch_deg", c.pitch_deg, "positive looks down", between(-90, 90));
  f.field("roll_deg", c.roll_deg, "positive leans right", between(-180, 180));
  f.field("clock_offset_s", c.clock_offset_s, "true time less what its stamps say; left out, 0",
          between(-0.1, 0.1));
  f.field("calibration_error", c.calibration_error,
          "what `run --fuse` takes its pose to be, less what it is");
  f.field("own_draws", c.own_draws,
          "phases, noise and detection drawn for this mount; left out, if there are several");
}

template <class Fields>
void visit(Fields& f, WeatherConfig& c) {
  f.field("rain_mm_per_h", c.rain_mm_per_h, "rain rate", between(0, 300));
  f.field("visibility_m", c.visibility_m, "meteorological optical range; .inf is clear air",
          positive(kInf));
  f.field("sunlight_klux", c.sunlight_klux, "on what the beams hit; 100 is full sun, 0 night",
          between(0, 200));
}

template <class Fields>
void visit(Fields& f, VehicleParts& c) {
  f.field("glass", c.glass, "windows, and what lies behind them");
  f.field("tyres", c.tyres, "dark rings");
  f.field("gap", c.gap, "air between wheels, below 0.2 m");
  f.field("coat", c.coat, "clear coat: less light at grazing angles");
  f.field("reflectors", c.reflectors, "number plates and lamps");
}

/// A scene names each side of the box.
template <class Fields>
void visit(Fields& f, CropBox& c) {
  static constexpr std::array kMin{"x_min_m", "y_min_m", "z_min_m"};
  static constexpr std::array kMax{"x_max_m", "y_max_m", "z_max_m"};
  const auto [min, max] = config::declaration(config::Of<CropBox>{}).parameters;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    f.field(kMin[axis], c.min_m[axis], min.doc, min.rule);
    f.field(kMax[axis], c.max_m[axis], max.doc, max.rule);
    f.check(c.max_m[axis] > c.min_m[axis], kMax[axis], "found it not above its minimum");
  }
}

template <class Fields>
void check(Fields& f, const CropPolygon& c) {
  f.check(c.outline_m.size() >= 3, "outline_m", "found fewer than 3 corners");
  f.check(signed_area(c.outline_m) != 0, "outline_m", "found no area, allowed an outline with one");
}

template <class Fields>
void check(Fields& f, const CropRange& c) {
  f.check(c.max_m > c.min_m, "max_m", "found it not above min_m, allowed above");
}

template <class Fields>
void check(Fields& f, const CropFieldOfView& c) {
  f.check(c.elevation_max_deg > c.elevation_min_deg, "elevation_max_deg",
          "found it not above elevation_min_deg, allowed above");
}

template <class Fields>
void check(Fields& f, const GroundMorphological& c) {
  f.check(c.window_m >= c.cell_m, "window_m", "found it below cell_m, allowed cell_m or more");
  f.check(c.max_range_m <= 2000 * c.cell_m, "max_range_m",
          "found more than 2000 cells of cell_m, allowed 2000");
}

template <class Fields, class Filter>
  requires requires { config::declaration(config::Of<Filter>{}); }
void visit(Fields& f, Filter& c) {
  std::apply([&](const auto&... p) { (f.field(p.name, c.*p.member, p.doc, p.rule), ...); },
             config::declaration(config::Of<Filter>{}).parameters);
  if constexpr (requires { check(f, c); }) check(f, c);
}

template <class Fields>
void visit(Fields& f, FilterConfig& c) {
  int steps = 0;
  config::for_each_filter(config::Of<decltype(c.step)>{},
                          [&]<class Filter>(config::Of<Filter> filter) {
                            std::optional<Filter> step;
                            if constexpr (std::is_same_v<Fields, config::FieldWriter>)
                              if (const auto* set = std::get_if<Filter>(&c.step)) step = *set;
                            const auto declared = config::declaration(filter);
                            f.field(declared.key, step, declared.doc);
                            if (!step) return;
                            c.step = *step;
                            ++steps;
                          });
  f.check(steps == 1, "crop_box", "found none or several steps, allowed one per entry");
}

bool is_folder_name(const std::string& name) {
  const bool plain = std::ranges::all_of(name, [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '-';
  });
  return plain && config::begins_as_name(name);
}

/// Several are folders, each beside the others and what a fusion writes.
template <class Fields>
void check_mounts(Fields& f, const SceneConfig& c) {
  for (const auto& [name, mount] : c.mounts) {
    const bool several = c.mounts.size() > 1;
    f.check(
        !several || (is_folder_name(name) && name != kFusedName), "mounts",
        "found '" + name + "' of several, allowed letters, digits, _ and -, and not " + kFusedName);
    f.check(several || !mount.calibration_error, "mounts",
            "found calibration_error of the only one, allowed with several");
  }
}

template <class Fields>
void visit(Fields& f, RegionConfig& c) {
  f.here(c.place);
  f.field("name", c.name, "name of the region", required());
  check_name(f, c.name);
  f.field("outline_m", c.outline_m, "corners x y in order, world", required(between(-1e6, 1e6)));
  const bool area = c.outline_m.size() >= 3 && signed_area(c.outline_m) != 0;
  f.check(area, "outline_m", "found fewer than 3 corners or no area, allowed an outline with one");
}

template <class Fields>
void check_regions(Fields& f, const std::optional<std::vector<RegionConfig>>& regions) {
  std::set<std::string> names;
  if (!regions) return;
  for (const RegionConfig& region : *regions)
    f.check(names.insert(region.name).second, "regions",
            "found '" + region.name + "' twice, allowed a name for each");
}

template <class Fields>
void visit_ways(Fields& f, SceneConfig& c) {
  f.field("lanes", c.lanes, "file of lanes with elevation, in place of roads; they are not drawn");
  f.field("roads", c.roads, "roads; left out with lanes",
          c.lanes ? config::Rule{} : at_least_one());
  f.check(!c.lanes || c.roads.empty(), "roads", "found them beside lanes, allowed one of the two");
  f.field("profile", c.profile, "rise along one direction, by which all that is level is lifted");
}

template <class Fields>
void visit(Fields& f, SceneConfig& c) {
  f.field("name", c.name, "name of the scene", required());
  f.check(config::begins_as_name(c.name), "name",
          "found '" + c.name + "', allowed a name that begins with a letter, a digit or _");
  f.field("seed", c.seed, "seed of traffic, phases and returns");
  f.field("duration_s", c.duration_s, "length of the run; a frame is 0.1 s",
          between(0.1, kLongestScene_s));
  f.check(std::abs(10 * c.duration_s - std::round(10 * c.duration_s)) < 1e-6, "duration_s",
          "found " + config::number_text(c.duration_s) + ", allowed whole tenths of a second");
  f.field("aggregation", c.aggregation.word, "exact, instant or slices:N");
  const auto aggregation = parse_aggregation(c.aggregation.word);
  f.check(aggregation.has_value(), "aggregation",
          "found '" + c.aggregation.word + "', allowed " + kAggregationWords);
  c.aggregation = aggregation.value_or(Aggregation{});
  f.field("detail", c.detail, "level of detail of the vehicles: box, low, mid, fine");
  f.field("vehicle_parts", c.vehicle_parts, "what returns.detection sees apart from paint");
  f.field("labels", c.labels, "which objects get a label: hit or all");
  f.field(
      "label_time", c.label_time,
      "pose of the labels: of mid-frame, or of the scan over the vehicle; left out, frame under "
      "the presets paper and equal, else scan");
  f.field("fields", c.point_fields, "write time, ring, class and object of every point");
  f.field("region_half_length_m", c.region_half_length_m,
          "half length of the evaluation region along each road; radius around the mount of lanes",
          between(1, 1e4));
  f.field("regions", c.regions, "outlines that the evaluation region is narrowed to",
          config::Rule{.min_items = 1});
  check_regions(f, c.regions);
  f.field("mounts", c.mounts, "sensor poses by name; each of several is a data set",
          at_least_one());
  check_mounts(f, c);
  f.field("weather", c.weather,
          "what attenuates or outshines the beams; no effect on LiDARs without returns.detection");
  visit_ways(f, c);
  f.field("meshes", c.meshes, "surfaces from files", config::Rule{.min_items = 1});
  f.check(!c.profile || !(c.lanes || c.meshes), "profile",
          "found it with lanes or meshes, allowed without: they have their own heights");
  f.field("ground", c.ground, "pieces of terrain");
  f.field("buildings", c.buildings, "upright boxes");
  f.field("barriers", c.barriers, "walls along roads");
  f.field("gantries", c.gantries, "beams across roads");
  f.field("vegetation", c.vegetation,
          "hedges and trees; LiDARs without returns.detection see no leaves");
  f.field("junctions", c.junctions, "signals where roads cross");
  f.field("filters", c.filters, "steps that thin out every frame, in order");
  f.field("traffic", c.traffic, "simulated vehicles");
  f.field("parked", c.parked, "rows of standing vehicles along roads");
  f.field("people", c.people, "on foot and on bicycles along roads");
  f.field("trajectories", c.trajectories, "file of recorded vehicles instead of traffic");
  f.field("static_layers", c.static_layers,
          "by LiDAR, a file of `infrasim static` in place of casting what stands still");
  f.check(!c.lanes || !c.traffic, "traffic",
          "found it with lanes of a file, allowed trajectories: own traffic needs roads");
  f.check(!c.static_layers || c.mounts.size() <= 1, "static_layers",
          "found them with several mounts, allowed with one, as a file is of one place");
  f.check(c.traffic.has_value() == c.trajectories.empty(), "traffic",
          "found both or neither, allowed either traffic or trajectories");
}

namespace {

SceneConfig scene_of(config::Tree tree, std::span<const std::string> assignments,
                     const std::string& preset) {
  const auto presets = config::take_presets(tree);
  if (presets) {
    for (std::size_t i = 0; i < presets->items.size(); ++i)
      config::expect_map(presets->items[i], "presets." + presets->keys[i]);
    if (const config::Tree* block = presets->find(preset)) tree = config::merged(tree, *block);
  }
  for (const std::string& assignment : assignments) config::override_value(tree, assignment);
  auto scene = config::read_struct<SceneConfig>(tree);
  scene.preset = preset;
  if (presets) scene.preset_blocks = presets->keys;
  return scene;
}

}  // namespace

SceneConfig read_scene(const std::filesystem::path& file, std::span<const std::string> assignments,
                       const std::string& preset) {
  SceneConfig scene = scene_of(config::read_tree(file), assignments, preset);
  scene.folder = file.parent_path();
  return scene;
}

SceneConfig parse_scene(const std::string& text, const std::string& name,
                        const std::string& preset) {
  return scene_of(config::parse_tree(text, name), {}, preset);
}

std::size_t road_index(const SceneConfig& scene, const std::string& name,
                       const config::Place& place, const char* key) {
  std::string names;
  for (std::size_t i = 0; i < scene.roads.size(); ++i) {
    if (scene.roads[i].name == name) return i;
    names += (names.empty() ? "" : ", ") + scene.roads[i].name;
  }
  const std::string allowed = names.empty() ? "none: the scene has no roads" : names;
  config::fail(place, key, "found unknown road '" + name + "', allowed " + allowed);
}

SceneConfig seen_from(const SceneConfig& scene, const std::string& mount) {
  const bool several = scene.mounts.size() > 1;
  const auto found = mount.empty() && !several ? scene.mounts.begin() : scene.mounts.find(mount);
  if (found == scene.mounts.end()) {
    std::string names;
    for (const auto& [name, pose] : scene.mounts) names += (names.empty() ? "" : ", ") + name;
    throw ConfigError("mount: found " + (mount.empty() ? "none" : "'" + mount + "'") +
                      ", allowed " + names);
  }
  SceneConfig view = scene;
  view.mounts = {*found};
  MountConfig& own = view.mounts[found->first];
  if (several && !own.own_draws) own.own_draws = true;
  own.calibration_error.reset();
  return view;
}

std::string dump_scene(const SceneConfig& scene) { return config::dump_struct(scene); }

std::string config::list_scene_keys() { return list_keys<SceneConfig>(); }

}  // namespace infrasim
