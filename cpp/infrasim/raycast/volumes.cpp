#include "infrasim/raycast/volumes.h"

#include "infrasim/core/classes.h"
#include "infrasim/core/math.h"

namespace infrasim {

namespace {

enum VolumeSample : unsigned { kLeaf, kFirstVolume };

constexpr double kVolumeMargin_m = 0.01;  // margin of nearest_m, larger than rounding errors

}  // namespace

Volumes::Volumes(std::span<const LeafVolume> volumes) {
  // The nearest volumes are first, because no random numbers are needed for volumes behind the
  // point at which a ray stops.
  std::vector<LeafVolume> by_distance(volumes.begin(), volumes.end());
  std::ranges::stable_sort(by_distance, {}, [](const LeafVolume& leaves) {
    return math::hypot(leaves.box.x, leaves.box.y);
  });
  std::vector<std::array<ViewBounds, 2>> views;
  for (const LeafVolume& leaves : by_distance) {
    const Box3d& box = leaves.box;
    Volume v{.ellipsoid = leaves.ellipsoid,
             .density_per_m = leaves.density_per_m,
             .cos = math::cos(box.heading),
             .sin = math::sin(box.heading),
             .inv_x = 2 / box.dx,
             .inv_y = 2 / box.dy,
             .inv_z = 2 / box.dz,
             .x = 0,
             .y = 0,
             .z = 0,
             .nearest_m = norm(Vec3{box.x, box.y, box.z}) - norm(Vec3{box.dx, box.dy, box.dz}) / 2 -
                          kVolumeMargin_m};
    v.x = -(v.cos * box.x + v.sin * box.y) * v.inv_x;
    v.y = (v.sin * box.x - v.cos * box.y) * v.inv_y;
    v.z = -box.z * v.inv_z;
    volumes_.push_back(v);
    views.push_back(view_of(footprint(box), box.z - box.dz / 2, box.z + box.dz / 2));
    for (const ViewBounds& view : views.back()) horizon_.add(view);
  }
  index_.set(std::move(views));
}

Volumes::Way Volumes::way_through(std::size_t volume, float dx, float dy, float dz) const {
  const Volume& v = volumes_[volume];
  const Vec3 o{v.x, v.y, v.z};
  const Vec3 d{(v.cos * dx + v.sin * dy) * v.inv_x, (v.cos * dy - v.sin * dx) * v.inv_y,
               dz * v.inv_z};
  if (v.ellipsoid) {
    const double a = dot(d, d), b = dot(o, d), c = dot(o, o) - 1, root = b * b - a * c;
    if (root <= 0) return {};
    return {std::max(0.0, (-b - std::sqrt(root)) / a), (-b + std::sqrt(root)) / a};
  }
  Way way{0, kInf};
  const auto slab = [&](double origin, double direction) {
    const double near = (-1 - origin) / direction, far = (1 - origin) / direction;
    // A ray in the plane of a side gives NaN. Comparisons with NaN leave the range unchanged.
    way.from = std::max(way.from, std::min(near, far));
    way.to = std::min(way.to, std::max(near, far));
  };
  slab(o.x, d.x);
  slab(o.y, d.y);
  slab(o.z, d.z);
  return way;
}

Volumes::RayWay Volumes::with_limit(RayWay way) const {
  constexpr double kSlack = 1e-5;  // larger than the errors of exp and log
  const double depth = volumes_[way.volume].density_per_m * (way.way.to - way.way.from);
  way.passes = math::exp(-depth) * (1 - kSlack);
  return way;
}

/// Each volume has its own random number. In overlapping volumes, the nearest stop therefore has
/// the distribution of the summed density.
void Volumes::stop_in(const RayWay& way, const Rng& rng, std::uint32_t ray, float max_range,
                      HitBatch& hits) const {
  const double sample = rng.open_uniform(kFirstVolume + way.volume);
  if (sample < way.passes) return;
  const double depth = -math::log(static_cast<float>(sample));
  const double range = way.way.from + depth / volumes_[way.volume].density_per_m;
  const auto stop = static_cast<float>(range);
  if (!(range < way.way.to && stop < hits.range[ray] && stop <= max_range)) return;
  hits.range[ray] = stop;
  hits.object[ray] = -1;
  hits.class_id[ray] = static_cast<std::uint16_t>(Class::kVegetation);
  // Leaves have random orientations. A leaf that faces the ray is hit more often, so the cosine of
  // incidence has the distribution P(cos < c) = c^2.
  hits.cos_incidence[ray] = static_cast<float>(std::sqrt(rng.open_uniform(kLeaf)));
}

double Volumes::transmission(float dx, float dy, float dz, double range) const {
  if (empty()) return 1;
  ViewBounds view;
  view.add(dx, dy, dz);
  double depth = 0;
  index_.for_each_in(view, [&](std::size_t v) {
    const Way way = way_through(v, dx, dy, dz);
    depth += volumes_[v].density_per_m * std::max(0.0, std::min(range, way.to) - way.from);
    return true;
  });
  return math::exp(-depth);
}

}  // namespace infrasim
