#include "infrasim/config/scene_keys.h"

#include "infrasim/core/math.h"

namespace infrasim {

using config::between;
using config::positive;
using config::required;

template <class Fields>
void visit(Fields& f, GroundConfig& c) {
  f.here(c.place);
  f.field("elevation_m", c.elevation_m, "world z of the terrain", required(between(-1e3, 1e4)));
  f.field("outline_m", c.outline_m, "convex outline, counter-clockwise", required());
  f.check(c.outline_m.size() >= 3, "outline_m", "expected 3 or more corners, got fewer");
  double turned = 0;
  bool left = true;
  for (std::size_t i = 0, n = c.outline_m.size(); i < n; ++i) {
    const Vec2 a = c.outline_m[i], b = c.outline_m[(i + 1) % n], d = c.outline_m[(i + 2) % n];
    left = left && cross(b - a, d - b) > 0;
    turned += math::atan2(cross(b - a, d - b), dot(b - a, d - b));
  }
  f.check(left && turned < 3 * kPi, "outline_m",
          "expected a convex outline, counter-clockwise, got corners that do not "
          "turn left once round");
}

template <class Fields>
void visit(Fields& f, MeshConfig& c) {
  f.here(c.place);
  f.field("file", c.file, ".ply in world coordinates, relative to the scene file", required());
  f.here(c.file_key, "file");
  f.field("material", c.material, "material of the surface", required());
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
  f.field("clearance_m", c.clearance_m, "clear height above the road", between(kClearance_m, 30));
}

template <class Fields>
void visit_density(Fields& f, double& density_per_m) {
  f.field("density_per_m", density_per_m, "probability per metre that a leaf stops a ray",
          positive(100));
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
  f.field("base_m", c.base_m, "height of its base above the road", between(-100, 100));
  visit_stations(f, c);
  visit_density(f, c.density_per_m);
}

template <class Fields>
void visit_shape(Fields& f, TreeShape& c, const char* base) {
  f.field("height_m", c.height_m, "height of the crown's top above the base", positive(100));
  f.field("crown_m", c.crown_m, "width of the crown", positive(50));
  f.field("trunk_m", c.trunk_m, "height of the crown's lowest leaves", between(0, 100));
  f.field("trunk_width_m", c.trunk_width_m, "thickness of the trunk", positive(5));
  f.field("base_m", c.base_m, base, between(-1e3, 1e4));
  visit_density(f, c.density_per_m);
  f.check(c.height_m > c.trunk_m, "height_m", "expected above trunk_m, got trunk_m or less");
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
  f.field("every_m", c.every_m, "distance between neighbours", between(1, 1e5));
  visit_stations(f, c, "station of the first tree");
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
          "expected one of hedge, hedge_along, tree, trees_along, got none or "
          "several");
}

template <class Fields>
void visit_static_objects(Fields& f, SceneConfig& c) {
  f.field("meshes", c.meshes, "triangle meshes from files", config::Rule{.min_items = 1});
  f.check(!c.profile || !(c.lanes || c.meshes), "profile",
          "expected no profile with lanes or meshes, which have their own heights, got one");
  f.field("ground", c.ground, "areas of terrain");
  f.field("buildings", c.buildings, "buildings, which are upright boxes");
  f.field("barriers", c.barriers, "walls along roads");
  f.field("gantries", c.gantries, "gantries across roads");
  f.field("vegetation", c.vegetation,
          "hedges and trees; LiDARs without returns.detection get no points from leaves");
}

template void visit_static_objects(config::FieldReader&, SceneConfig&);
template void visit_static_objects(config::FieldWriter&, SceneConfig&);
template void visit_static_objects(config::FieldLister&, SceneConfig&);

}  // namespace infrasim
