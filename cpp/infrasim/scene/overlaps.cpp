#include "infrasim/scene/overlaps.h"

#include <algorithm>
#include <array>

namespace infrasim {

namespace {

/// Footprint and bounding rectangle of an object, for a sweep along one axis.
struct Extent {
  int id = 0;
  Box3d box;
  std::array<Vec2, 4> outline;
  Vec2 low, high;
};

Extent extent(int id, Box3d box) {
  box.dx -= kTouch_m;
  box.dy -= kTouch_m;
  Extent out{id, box, footprint(box), {}, {}};
  const auto [left, right] = std::ranges::minmax(out.outline, {}, &Vec2::x);
  const auto [down, up] = std::ranges::minmax(out.outline, {}, &Vec2::y);
  out.low = {left.x, down.y};
  out.high = {right.x, up.y};
  return out;
}

double reach(const Box3d& box, Vec3 direction) {
  const Mat3 axes = rotation(box.heading, box.pitch, 0);
  const auto along = [&](Vec3 half) { return std::abs(dot(axes * half, direction)); };
  return along({box.dx / 2, 0, 0}) + along({0, box.dy / 2, 0}) + along({0, 0, box.dz / 2});
}

/// Returns whether one object is above the other, which means that the two boxes do not overlap
/// along the up axis of one of them.
bool one_over_other(const Box3d& a, const Box3d& b) {
  return std::ranges::any_of(std::array{a, b}, [&](const Box3d& box) {
    const Vec3 up = rotation(box.heading, box.pitch, 0) * Vec3{0, 0, 1};
    const double apart = std::abs(dot(Vec3{a.x - b.x, a.y - b.y, a.z - b.z}, up));
    return apart >= reach(a, up) + reach(b, up) - kTouch_m;
  });
}

bool overlap(const Extent& a, const Extent& b) {
  if (a.high.x <= b.low.x || b.high.x <= a.low.x) return false;
  if (a.high.y <= b.low.y || b.high.y <= a.low.y) return false;
  return footprints_overlap(a.outline, b.outline) && !one_over_other(a.box, b.box);
}

/// Returns the axis along which the objects cover the larger extent. Along this axis, fewer extents
/// overlap.
double Vec2::* longer_axis(const std::vector<Extent>& extents) {
  const auto spread = [&](double Vec2::* axis) {
    const auto at = [&](const Extent& e) { return e.low.*axis; };
    const auto [first, last] = std::ranges::minmax(extents, {}, at);
    return at(last) - at(first);
  };
  return extents.empty() || spread(&Vec2::x) >= spread(&Vec2::y) ? &Vec2::x : &Vec2::y;
}

}  // namespace

void OverlapSearch::take(const std::vector<ObjectState>& states) {
  const double time_s = instants_++ * kRowStep_s;
  std::vector<std::pair<int, Box3d>> boxes;
  for (const MovingObject& o : objects_between(before_, states))
    boxes.emplace_back(o.id, o.at(0.5));
  look(boxes, time_s - kRowStep_s / 2);
  boxes.clear();
  for (const ObjectState& s : states) boxes.emplace_back(s.id, s.box);
  look(boxes, time_s);
  before_ = states;
}

void OverlapSearch::look(const std::vector<std::pair<int, Box3d>>& boxes, double time_s) {
  std::vector<Extent> extents;
  for (const auto& [id, box] : boxes) extents.push_back(extent(id, box));
  const auto axis = longer_axis(extents);
  std::ranges::sort(extents, {}, [&](const Extent& e) { return e.low.*axis; });
  for (std::size_t i = 0; i < extents.size(); ++i)
    for (std::size_t j = i + 1; j < extents.size(); ++j) {
      const Extent &a = extents[i], &b = extents[j];
      if (b.low.*axis >= a.high.*axis) break;
      if (!overlap(a, b)) continue;
      const auto ids = std::minmax(a.id, b.id);
      if (pairs_.insert(ids).second)
        overlaps_.push_back(
            {ids.first, ids.second, time_s, {(a.box.x + b.box.x) / 2, (a.box.y + b.box.y) / 2}});
    }
}

}  // namespace infrasim
