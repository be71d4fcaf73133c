#include "infrasim/core/geometry.h"

#include <algorithm>

#include "infrasim/core/math.h"

namespace infrasim {

namespace {

/// Returns whether `b` lies completely on the outer side of a line along an edge of `a`.
bool separated_by_edge(std::span<const Vec2> a, std::span<const Vec2> b) {
  for (std::size_t i = 0; i < a.size(); ++i) {
    const Vec2 from = a[i], edge = a[(i + 1) % a.size()] - from;
    if (edge.x == 0 && edge.y == 0) continue;
    if (std::ranges::all_of(b, [&](Vec2 p) { return cross(edge, p - from) <= 0; })) return true;
  }
  return false;
}

}  // namespace

Box3d levelled(const Box3d& box) {
  if (box.pitch == 0) return box;
  const double c = std::abs(math::cos(box.pitch)), s = std::abs(math::sin(box.pitch));
  Box3d out = box;
  out.dx = c * box.dx + s * box.dz;
  out.dz = s * box.dx + c * box.dz;
  out.pitch = 0;
  return out;
}

BoxFrame::BoxFrame(const Box3d& box)
    : box_(box),
      cos_(math::cos(box.heading)),
      sin_(math::sin(box.heading)),
      cos_pitch_(math::cos(box.pitch)),
      sin_pitch_(math::sin(box.pitch)) {}

Vec3 BoxFrame::to_box(Vec3 p) const {
  const double x = p.x - box_.x, y = p.y - box_.y;
  const Vec3 level{cos_ * x + sin_ * y, -sin_ * x + cos_ * y, p.z - box_.z};
  if (sin_pitch_ == 0) return level;
  return {cos_pitch_ * level.x - sin_pitch_ * level.z, level.y,
          sin_pitch_ * level.x + cos_pitch_ * level.z};
}

Vec3 BoxFrame::from_box(Vec3 local) const {
  if (sin_pitch_ != 0)
    local = {cos_pitch_ * local.x + sin_pitch_ * local.z, local.y,
             -sin_pitch_ * local.x + cos_pitch_ * local.z};
  return {box_.x + cos_ * local.x - sin_ * local.y, box_.y + sin_ * local.x + cos_ * local.y,
          box_.z + local.z};
}

bool BoxFrame::contains(Vec3 p, double margin) const {
  const Vec3 local = to_box(p);
  return std::abs(local.x) <= box_.dx / 2 + margin && std::abs(local.y) <= box_.dy / 2 + margin &&
         std::abs(local.z) <= box_.dz / 2 + margin;
}

Vec3 BoxFrame::nearest(Vec3 p) const {
  const Vec3 local = to_box(p);
  return from_box({std::clamp(local.x, -box_.dx / 2, box_.dx / 2),
                   std::clamp(local.y, -box_.dy / 2, box_.dy / 2),
                   std::clamp(local.z, -box_.dz / 2, box_.dz / 2)});
}

std::array<Vec2, 4> footprint(const Box3d& box) {
  const Vec2 centre{box.x, box.y};
  const Vec2 along = box.dx / 2 * heading_vector(box.heading);
  const Vec2 left = box.dy / 2 * heading_vector(box.heading + kPi / 2);
  return {centre + along - left, centre + along + left, centre - along + left,
          centre - along - left};
}

double signed_area(std::span<const Vec2> outline) {
  double twice = 0;
  for (std::size_t i = 0, j = outline.size() - 1; i < outline.size(); j = i++)
    twice += cross(outline[j], outline[i]);
  return twice / 2;
}

bool footprints_overlap(std::span<const Vec2> a, std::span<const Vec2> b) {
  return !separated_by_edge(a, b) && !separated_by_edge(b, a);
}

bool covers(std::span<const Vec2> outline, Vec2 point) {
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const Vec2 from = outline[i];
    if (cross(outline[(i + 1) % outline.size()] - from, point - from) < 0) return false;
  }
  return true;
}

bool encloses(std::span<const Vec2> outline, Vec2 point) {
  bool inside = false;
  for (std::size_t i = 0, j = outline.size() - 1; i < outline.size(); j = i++) {
    const Vec2 a = outline[i], b = outline[j];
    if ((a.y > point.y) != (b.y > point.y) &&
        point.x < a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x))
      inside = !inside;
  }
  return inside;
}

}  // namespace infrasim
