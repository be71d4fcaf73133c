#include "infrasim/raycast/moving_bodies.h"

#include "infrasim/core/math.h"

namespace infrasim {

namespace {

constexpr double kMargin_m = 0.02;  // margin of the swept box, larger than any rounding error

/// Returns a box, along the body's heading at mid-frame, that contains the body during the whole
/// frame. A corner of a turning body deviates from the chord of its path by at most the sagitta.
Box3d swept(const MovingBody& body) {
  Box3d box = box_at(body, 0.5);
  const Vec2 axis = heading_vector(box.heading);
  double front = 0, side = 0;
  for (const Box3d& end : {levelled(body.from), levelled(body.to)})
    for (const Vec2& corner : footprint(end)) {
      const Vec2 d = corner - Vec2{box.x, box.y};
      front = std::max(front, std::abs(dot(axis, d)));
      side = std::max(side, std::abs(cross(axis, d)));
    }
  const double turn = std::abs(wrap_angle(body.to.heading - body.from.heading));
  const double margin = kMargin_m + math::hypot(box.dx, box.dy) / 2 * (1 - math::cos(turn / 2));
  box.dx = 2 * (front + margin);
  box.dy = 2 * (side + margin);
  box.dz = std::max(levelled(body.from).dz, levelled(body.to).dz);
  box.dz += std::abs(body.to.z - body.from.z) + 2 * kMargin_m;
  box.pitch = 0;
  return box;
}

}  // namespace

Box3d box_at(const MovingBody& body, double share) {
  Box3d box = body.from;
  box.x += share * (body.to.x - body.from.x);
  box.y += share * (body.to.y - body.from.y);
  box.z += share * (body.to.z - body.from.z);
  box.heading += share * wrap_angle(body.to.heading - body.from.heading);
  box.pitch += share * (body.to.pitch - body.from.pitch);
  return box;
}

BodyMotion::BodyMotion(const MovingBody& body)
    : x_(static_cast<float>(body.from.x)),
      y_(static_cast<float>(body.from.y)),
      z_(static_cast<float>(body.from.z)),
      travel_x_(static_cast<float>(body.to.x - body.from.x)),
      travel_y_(static_cast<float>(body.to.y - body.from.y)),
      travel_z_(static_cast<float>(body.to.z - body.from.z)),
      heading_(static_cast<float>(body.from.heading)),
      turn_(static_cast<float>(wrap_angle(body.to.heading - body.from.heading))),
      cos_(static_cast<float>(math::cos(body.from.heading))),
      sin_(static_cast<float>(math::sin(body.from.heading))),
      pitch_(static_cast<float>(body.from.pitch)),
      pitch_turn_(static_cast<float>(body.to.pitch - body.from.pitch)),
      inv_dx_(static_cast<float>(1 / body.from.dx)),
      inv_dy_(static_cast<float>(1 / body.from.dy)),
      inv_dz_(static_cast<float>(1 / body.from.dz)) {}

void BodyIndex::set(std::span<const MovingBody> bodies) {
  std::vector<std::array<ViewBounds, 2>> views;
  for (const MovingBody& body : bodies) {
    const Box3d box = swept(body);
    views.push_back(view_of(footprint(box), box.z - box.dz / 2, box.z + box.dz / 2));
  }
  set(std::move(views));
}

void BodyIndex::set(std::vector<std::array<ViewBounds, 2>> views) {
  bounds_ = std::move(views);
  words_ = (bounds_.size() + 63) / 64;
  bins_.assign(kBins * words_, 0);
  for (std::size_t i = 0; i < bounds_.size(); ++i)
    for (const ViewBounds& part : bounds_[i])
      if (!part.empty())
        for (std::size_t b = bin(part.left); b <= bin(part.right); ++b)
          bins_[b * words_ + i / 64] |= std::uint64_t{1} << (i % 64);
}

}  // namespace infrasim
