#include "infrasim/core/geometry.h"

#include <algorithm>

namespace infrasim {

std::array<Vec2, 4> footprint(const Box3d& box) {
  const Vec2 centre{box.x, box.y};
  const Vec2 along = box.dx / 2 * heading_vector(box.heading);
  const Vec2 left = box.dy / 2 * heading_vector(box.heading + kPi / 2);
  return {centre + along - left, centre + along + left, centre - along + left,
          centre - along - left};
}

namespace {

/// True if a line along an edge of `a` has all of `b` on its outer side.
bool separated_by_edge(std::span<const Vec2> a, std::span<const Vec2> b) {
  for (std::size_t i = 0; i < a.size(); ++i) {
    const Vec2 from = a[i], edge = a[(i + 1) % a.size()] - from;
    if (edge.x == 0 && edge.y == 0) continue;
    if (std::ranges::all_of(b, [&](Vec2 p) { return cross(edge, p - from) <= 0; })) return true;
  }
  return false;
}

}  // namespace

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
