#include "infrasim/scene/vegetation.h"

#include <algorithm>
#include <cmath>

#include "infrasim/config/fields.h"

namespace infrasim {

namespace {

// length of a piece of a hedge along a straight road; short, so that each piece is tested against
// few rays
constexpr double kPiece_m = 20;
// length of a piece of a hedge in bends and on slopes, as for barriers
constexpr double kBentPiece_m = 2;

/// A tree and its position in the scene.
struct Tree {
  Vec2 foot;
  double base = 0;
  double heading = 0;
  TreeShape shape;
  config::Place place;
  const char* key;
};

std::vector<Tree> trees_along(const Road& road, const TreesAlongConfig& row) {
  const Curve& line = road.centreline;
  const double to = end_of(line, row, true);
  std::vector<Tree> out;
  for (int i = 0; row.from_m + i * row.every_m <= to; ++i) {
    const CurvePoint p = line.at(row.from_m + i * row.every_m);
    out.push_back({p.position + row.offset_m * heading_vector(p.heading + kPi / 2),
                   road.config.elevation_m + row.shape.base_m, p.heading, row.shape, row.place,
                   "offset_m"});
  }
  return out;
}

std::vector<Tree> trees(const SceneConfig& scene, std::span<const Curve> centrelines) {
  std::vector<Tree> out;
  for (const VegetationConfig& v : scene.vegetation) {
    if (v.tree)
      out.push_back({{v.tree->x_m, v.tree->y_m},
                     v.tree->shape.base_m,
                     0,
                     v.tree->shape,
                     v.tree->place,
                     "x_m"});
    if (!v.trees_along) continue;
    const std::vector<Tree> row = trees_along(
        road_named(scene, centrelines, v.trees_along->road, v.trees_along->place), *v.trees_along);
    out.insert(out.end(), row.begin(), row.end());
  }
  return out;
}

/// Adds a hedge along a road, cut into pieces.
/// @param level true if the scene has no profile
void add_hedge_along(const Road& road, const HedgeAlongConfig& hedge, bool level,
                     std::vector<LeafVolume>& out) {
  const BarrierConfig line{hedge.road,   hedge.offset_m, hedge.height_m, hedge.width_m,
                           hedge.from_m, hedge.to_m,     hedge.place};
  const bool straight = std::isinf(road.centreline.tightest_radius());
  for (Box3d piece : barrier_pieces(road, line, straight && level ? kPiece_m : kBentPiece_m)) {
    piece.z += hedge.base_m;
    out.push_back({piece, false, hedge.density_per_m, hedge.place, "offset_m", "a hedge"});
  }
}

/// Adds a hedge that is given by its centre. If the scene has a profile, the hedge is cut into
/// pieces, and the profile raises each piece.
void add_hedge(const HedgeConfig& h, bool level, std::vector<LeafVolume>& out) {
  const auto cut = [&](double m) { return level ? 1.0 : std::ceil(m / kBentPiece_m); };
  const double along = cut(h.length_m), across = cut(h.width_m), heading = rad(h.heading_deg);
  const double dx = h.length_m / along, dy = h.width_m / across;
  for (double i = 0; i < along; ++i)
    for (double j = 0; j < across; ++j) {
      const Vec2 centre = Vec2{h.x_m, h.y_m} +
                          (dx * (i - (along - 1) / 2)) * heading_vector(heading) +
                          (dy * (j - (across - 1) / 2)) * heading_vector(heading + kPi / 2);
      const double z = h.base_m + h.height_m / 2;
      out.push_back({{centre.x, centre.y, z, dx, dy, h.height_m, heading},
                     false,
                     h.density_per_m,
                     h.place,
                     "x_m",
                     "a hedge"});
    }
}

}  // namespace

bool holds(const LeafVolume& volume, Vec3 point) {
  const Box3d& box = volume.box;
  const Vec2 d{point.x - box.x, point.y - box.y}, axis = heading_vector(box.heading);
  const Vec3 unit{2 * dot(axis, d) / box.dx, 2 * cross(axis, d) / box.dy,
                  2 * (point.z - box.z) / box.dz};
  if (volume.ellipsoid) return norm(unit) <= 1;
  return std::max({std::abs(unit.x), std::abs(unit.y), std::abs(unit.z)}) <= 1;
}

std::vector<LeafVolume> leaf_volumes(const SceneConfig& scene, std::span<const Curve> centrelines) {
  const bool level = !scene.profile;
  std::vector<LeafVolume> out;
  for (const VegetationConfig& v : scene.vegetation) {
    if (v.hedge) add_hedge(*v.hedge, level, out);
    if (v.hedge_along)
      add_hedge_along(road_named(scene, centrelines, v.hedge_along->road, v.hedge_along->place),
                      *v.hedge_along, level, out);
  }
  for (const Tree& tree : trees(scene, centrelines)) {
    const TreeShape& s = tree.shape;
    out.push_back({{tree.foot.x, tree.foot.y, tree.base + (s.trunk_m + s.height_m) / 2, s.crown_m,
                    s.crown_m, s.height_m - s.trunk_m, tree.heading},
                   true,
                   s.density_per_m,
                   tree.place,
                   tree.key,
                   "a crown"});
  }
  return out;
}

std::vector<StaticBox> trunks(const SceneConfig& scene, std::span<const Curve> centrelines) {
  std::vector<StaticBox> out;
  for (const Tree& tree : trees(scene, centrelines)) {
    const TreeShape& s = tree.shape;
    const double height = (s.trunk_m + s.height_m) / 2;
    out.push_back({{tree.foot.x, tree.foot.y, tree.base + height / 2, s.trunk_width_m,
                    s.trunk_width_m, height, tree.heading},
                   tree.place,
                   tree.key,
                   "a tree"});
  }
  return out;
}

}  // namespace infrasim
