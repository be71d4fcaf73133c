#include "infrasim/pipeline/transparent.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "infrasim/sensor/reflectance.h"

namespace infrasim {

namespace {

constexpr int kMostTimes = 4;  // maximum number of additional casts of a ray
constexpr float kNever = std::numeric_limits<float>::infinity();
constexpr double kLevelNormal = 0.9;  // minimum |z| of the unit normal of a vehicle's lower face

Echo vehicle_echo(float range, std::int32_t object, const Optics& optics) {
  return {range, object, 0, optics.reflectance, optics.gain};
}

/// Returns a range slightly behind a hit, so that the next cast does not find the same hit.
float beyond(float range) { return range + std::max(2e-4F, 2e-6F * range); }

/// Returns the range at which a ray through a pane meets the floor of the cabin.
float floor_range(float range, const BodyHit& hit, float dz) {
  const double above = (hit.at.z + 0.5) * hit.size_m.z - kSillHeight_m;
  return dz < 0 ? range + static_cast<float>(above / -dz) : kNever;
}

}  // namespace

std::size_t TransparentCaster::resolve(const RayBatch& rays, const FrameVehicles& vehicles,
                                       const VehicleParts& parts, const EchoPath& path,
                                       HitBatch& hits, EchoBatch& echoes,
                                       const StaticSlice& background,
                                       std::vector<WeakerEcho>* weaker) {
  vehicles_ = &vehicles;
  weaker_ = weaker;
  if (weaker_ != nullptr) weaker_->clear();
  parts_ = parts;
  path_ = path;
  background_ = background;
  echoes_ = &echoes;
  echoes.take(hits);
  next_.clear();
  for (std::size_t i = 0; i < echoes.size(); ++i)
    if (echoes.object[i] < 0) {
      const auto material = static_cast<Class>(echoes.class_id[i]);
      echoes.reflectance[i] = background_reflectance(material);
    } else {
      meet_vehicle(
          rays, {.ray = static_cast<std::uint32_t>(i)},
          {echoes.range[i], echoes.gain[i], echoes.object[i], echoes.class_id[i], hits.place[i]});
    }
  std::size_t cast = 0;
  for (int times = 0; times < kMostTimes && !next_.empty(); ++times) {
    cast += next_.size();
    cast_on(rays);
  }
  if (weaker_ != nullptr) std::ranges::stable_sort(*weaker_, {}, &WeakerEcho::ray);
  return cast;
}

void TransparentCaster::cast_on(const RayBatch& rays) {
  passing_.swap(next_);
  next_.clear();
  on_.resize(passing_.size());
  on_.near.resize(passing_.size());
  on_.max_range = rays.max_range;
  on_order_.resize(passing_.size());
  std::iota(on_order_.begin(), on_order_.end(), 0U);
  for (std::size_t k = 0; k < passing_.size(); ++k) {
    const std::uint32_t i = passing_[k].ray;
    on_.dx[k] = rays.dx[i];
    on_.dy[k] = rays.dy[i];
    on_.dz[k] = rays.dz[i];
    on_.time[k] = rays.time[i];
    on_.near[k] = passing_[k].near;
  }
  if (background_.empty())
    raycaster_.cast(on_, on_order_, on_hits_);
  else
    cast_on_with(background_);
  for (std::size_t k = 0; k < passing_.size(); ++k) meet(rays, passing_[k], on_hits_.at(k));
}

/// Casts the continued rays at vehicles only, because the hits on static surfaces are known.
void TransparentCaster::cast_on_with(const StaticSlice& background) {
  on_hits_.resize(on_.size());
  std::ranges::fill(on_hits_.object, -1);
  for (std::size_t k = 0; k < on_.size(); ++k) {
    const std::uint32_t i = background.number[passing_[k].ray];
    const bool ahead = background.range_m[i] >= on_.near[k];
    on_hits_.range[k] = ahead ? background.range_m[i] : kNever;
    on_hits_.cos_incidence[k] = background.gain[i];
    on_hits_.class_id[k] = ahead ? background.class_id[i] : std::uint16_t{0};
  }
  raycaster_.cast_bodies(on_, on_order_, on_hits_);
}

void TransparentCaster::meet(const RayBatch& rays, const Passing& state, const Hit& hit) {
  const float range = hit.range;
  if (state.floor_range < range)
    return keep_strongest(rays, state,
                          vehicle_echo(state.floor_range, state.object,
                                       interior_optics(std::abs(rays.dz[state.ray]))));
  if (!std::isfinite(range)) return;
  if (hit.object >= 0) return meet_vehicle(rays, state, hit);
  keep_strongest(
      rays, state,
      background_echo(range, static_cast<Class>(hit.class_id), state.ray, hit.cos_incidence));
}

void TransparentCaster::meet_vehicle(const RayBatch& rays, const Passing& state, const Hit& hit) {
  const float range = hit.range;
  const std::int32_t object = hit.object;
  const auto index = static_cast<std::size_t>(object);
  const Class object_class = vehicles_->moving[index].object_class;
  const double cosine = hit.cos_incidence;
  if (!parts_.any())
    return keep_strongest(
        rays, state,
        vehicle_echo(range, object, {vehicles_->reflectance[index], hit.cos_incidence}));
  const BodyHit body = body_hit(hit);
  const Part part = part_at(body, parts_);
  if (state.object == object && state.under) return meet_below(rays, body, part, state, hit);
  const bool inside = state.object == object;
  if (inside && part != Part::kGlass)
    return keep_strongest(rays, state, vehicle_echo(range, object, interior_optics(cosine)));
  Passing on = state;
  on.near = beyond(range);
  on.object = inside ? -1 : object;
  on.under = part == Part::kGap;
  on.floor_range = inside || on.under ? kNever : floor_range(range, body, rays.dz[state.ray]);
  const Optics optics =
      optics_of(part, object_class, vehicles_->reflectance[index], cosine, parts_);
  if (part == Part::kGap) {
    if (state.near == 0) echoes_->range[state.ray] = kNever, echoes_->object[state.ray] = -1;
    next_.push_back(on);
    return;
  }
  keep_strongest(rays, state, vehicle_echo(range, object, optics));
  if (part != Part::kGlass || !sees_through(object_class)) return;
  on.power *= kPaneTwice;
  next_.push_back(on);
}

/// Processes the next hit of a ray that passes below a body, if the hit is on the same body.
void TransparentCaster::meet_below(const RayBatch& rays, const BodyHit& body, Part part,
                                   const Passing& state, const Hit& hit) {
  const float range = hit.range;
  // The lower face of a body lies on the ground, so a ray that meets this face also meets the
  // ground.
  if (body.at.z < 0 && std::abs(body.normal.z) > kLevelNormal) {
    const bool on_lane = vehicles_->on_lane[static_cast<std::size_t>(hit.object)];
    const Class ground = on_lane ? Class::kRoad : static_cast<Class>(hit.class_id);
    return keep_strongest(rays, state,
                          background_echo(range, ground, state.ray, hit.cos_incidence));
  }
  if (part != Part::kGap)
    return keep_strongest(rays, state,
                          vehicle_echo(range, hit.object, interior_optics(hit.cos_incidence)));
  Passing on = state;
  on.near = beyond(range);
  on.object = -1;
  on.under = false;
  next_.push_back(on);
}

BodyHit TransparentCaster::body_hit(const Hit& hit) const {
  const auto index = static_cast<std::size_t>(hit.object);
  const Box3d& box = vehicles_->boxes[index];
  const auto& [at, normal] = hit.place;
  return {.object_class = vehicles_->moving[index].object_class,
          .size_m = {box.dx, box.dy, box.dz},
          .at = {at[0], at[1], at[2]},
          .normal = {normal[0], normal[1], normal[2]}};
}

/// Returns the echo of a background surface.
/// @param cosine cosine of incidence; for a recorded surface, the stored gain is used instead
Echo TransparentCaster::background_echo(float range, Class material, std::uint32_t ray,
                                        float cosine) const {
  const float gain =
      material == Class::kRecorded ? background_.gain[background_.number[ray]] : cosine;
  return {range, -1, static_cast<std::uint16_t>(material), background_reflectance(material), gain};
}

/// Stores an echo as the strongest echo of its ray, unless the stored echo is stronger.
void TransparentCaster::keep_strongest(const RayBatch& rays, const Passing& state, Echo echo) {
  const std::uint32_t i = state.ray;
  const std::uint16_t ring = rays.ring[i];
  echo.reflectance *= state.power;
  const auto power = [&](float reflected, float range) {
    return path_.share(range, ring) * reflected / (range * range);
  };
  const bool first = state.near == 0;
  if (first || !std::isfinite(echoes_->range[i])) return echoes_->set(i, echo);
  Echo kept = echoes_->at(i);
  if (power(kept.reflectance * kept.gain, kept.range) <
      power(echo.reflectance * echo.gain, echo.range))
    std::swap(kept, echo);
  echoes_->set(i, kept);
  if (weaker_ != nullptr) weaker_->push_back({i, echo});
}

}  // namespace infrasim
