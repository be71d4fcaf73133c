#include "infrasim/pipeline/vehicles.h"

#include <cmath>

#include "infrasim/core/math.h"
#include "infrasim/core/rng.h"
#include "infrasim/scene/parked.h"
#include "infrasim/scene/vehicle_body.h"
#include "infrasim/sensor/reflectance.h"

namespace infrasim {

namespace {

/// Returns false if the horizontal distance of the object from the sensor exceeds `reach` metres
/// during the whole frame. May return true for an object slightly beyond `reach`.
bool reachable(const MovingObject& o, const Box3d& middle, double reach) {
  const double travel = math::hypot(o.to.x - o.from.x, o.to.y - o.from.y);
  const double half_diagonal = math::hypot(levelled(middle).dx, middle.dy) / 2;
  return math::hypot(middle.x, middle.y) <= reach + half_diagonal + travel / 2 + 0.1;
}

// metres, upper limit of the distance of any part of an object from the middle of its path
constexpr double kLargestObject_m = 100;

/// Returns true if the middle of the object's path is so far away that the object is not reachable.
/// This costs less than the exact test, which most objects of a large map do not need.
bool far_beyond(const MovingObject& o, Vec3 sensor, double reach) {
  const double x = (o.from.x + o.to.x) / 2 - sensor.x, y = (o.from.y + o.to.y) / 2 - sensor.y;
  const double most = reach + kLargestObject_m;
  return x * x + y * y > most * most;
}

}  // namespace

FrameVehicles set_vehicles(const World& world, int k, double period_s, double reach,
                           Raycaster& raycaster) {
  const Rng paint = Rng::of(world.scene.seed, "paint");
  FrameVehicles out;
  for (const MovingObject& o : world.objects_in_frame(k, period_s)) {
    if (far_beyond(o, world.level.origin, reach)) continue;
    const Box3d box = world.level.to_level(o.at(0.5));
    if (!reachable(o, box, reach)) continue;
    out.moving.push_back(o);
    out.bodies.push_back({static_cast<int>(body_index(o.object_class)),
                          world.level.to_level(body_box(o.from)),
                          world.level.to_level(body_box(o.to))});
    out.boxes.push_back(box);
    out.on_lane.push_back(world.scene.traffic && o.id < kFirstParkedId);
    out.reflectance.push_back(paint_reflectance(paint.at(static_cast<std::uint64_t>(o.id) + 1)));
  }
  raycaster.set_bodies(out.bodies, period_s);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const Box3d middle = out.moving[i].at(0.5);
    const bool inside = world.region.contains({middle.x, middle.y}, out.moving[i].object_class);
    out.visibility.push_back(inside ? raycaster.visibility(i, world.leaves) : -1);
  }
  return out;
}

void freeze_vehicles(const World& world, const FrameVehicles& vehicles, double period_s,
                     double share, Raycaster& raycaster) {
  std::vector<MovingBody> bodies = vehicles.bodies;
  for (std::size_t i = 0; i < bodies.size(); ++i)
    bodies[i].from = bodies[i].to = world.level.to_level(body_box(vehicles.moving[i].at(share)));
  raycaster.set_bodies(bodies, period_s);
}

}  // namespace infrasim
