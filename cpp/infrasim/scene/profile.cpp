#include "infrasim/scene/profile.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "infrasim/core/math.h"

namespace infrasim {

namespace {

constexpr double kOff_m = 0.01;  // maximum deviation of a triangle's edge from the profile
// wheelbase divided by vehicle length: 0.57 to 0.62 for cars, less for trucks and buses
constexpr double kWheelbase = 0.6;

}  // namespace

Profile::Profile(const SceneConfig& scene) {
  if (!scene.profile) return;
  const ProfileConfig& c = *scene.profile;
  origin_ = {c.x_m, c.y_m};
  axis_ = heading_vector(rad(c.heading_deg));
  curve_m_ = c.vertical_curve_m;
  first_m_ = c.points_m.front().y;
  double before = 0;
  for (std::size_t i = 0; i < c.points_m.size(); ++i) {
    const bool last = i + 1 == c.points_m.size();
    const Vec2 step = last ? Vec2{1, 0} : c.points_m[i + 1] - c.points_m[i];
    const double grade = step.y / step.x;
    changes_.push_back({c.points_m[i].x, grade - before});
    before = grade;
  }
}

double Profile::rise_at(double s) const {
  double z = first_m_;
  for (const Change& change : changes_) {
    const double beyond = s - change.s, half = curve_m_ / 2;
    if (beyond >= half)
      z += change.grade * beyond;
    else if (beyond > -half)
      z += change.grade * (beyond + half) * (beyond + half) / (2 * curve_m_);
  }
  return z;
}

double Profile::station(Vec2 place) const { return dot(place - origin_, axis_); }

double Profile::rise(Vec2 place) const { return rise_at(station(place)); }

/// Returns the length of an edge along the profile if the edge must be cut, otherwise 0. A chord
/// deviates from the profile by at most a quarter of its length times the change of grade over this
/// length. Parts of the edge deviate less, so the cutting ends.
double Profile::bent(Vec3 from, Vec3 to) const {
  const auto [a, b] = std::minmax({station({from.x, from.y}), station({to.x, to.y})});
  double turned = 0;
  for (const Change& change : changes_) {
    const double first = std::max(a, change.s - curve_m_ / 2);
    const double last = std::min(b, change.s + curve_m_ / 2);
    if (last > first) turned += std::abs(change.grade) * (last - first) / curve_m_;
  }
  return (b - a) / 4 * turned > kOff_m ? b - a : 0;
}

/// Halves the longest bent edge of every triangle until no edge is bent.
void Profile::cut(Surface& surface) const {
  auto& vertices = surface.vertices;
  for (std::size_t i = 0; i < surface.triangles.size();) {
    const auto t = surface.triangles[i];
    std::array<double, 3> length{};
    for (std::size_t k = 0; k < 3; ++k)
      length.at(k) = bent(vertices[t.at(k)], vertices[t.at((k + 1) % 3)]);
    const auto longest = std::ranges::max_element(length);
    if (*longest == 0) {
      ++i;
      continue;
    }
    const auto k = static_cast<std::size_t>(longest - length.begin());
    const auto a = t.at(k), b = t.at((k + 1) % 3), c = t.at((k + 2) % 3);
    const auto middle = static_cast<std::uint32_t>(vertices.size());
    vertices.push_back(0.5 * (vertices[a] + vertices[b]));
    surface.triangles[i] = {a, middle, c};
    surface.triangles.push_back({middle, b, c});
    surface.class_id.push_back(surface.class_id[i]);
  }
}

void Profile::lift(Surface& surface) const {
  if (level()) return;
  cut(surface);
  for (Vec3& v : surface.vertices) v.z += rise({v.x, v.y});
}

/// Puts a box on the slope. The centre of the box is over the middle of the line between the axles.
Box3d Profile::on_slope(const Box3d& box) const {
  const Vec2 half = (kWheelbase * box.dx / 2) * heading_vector(box.heading);
  const Vec2 place{box.x, box.y};
  const double front = rise(place + half), rear = rise(place - half);
  Box3d out = box;
  out.pitch = math::atan2(rear - front, kWheelbase * box.dx);
  const Vec3 up = rotation(box.heading, out.pitch, 0) * Vec3{0, 0, box.dz / 2};
  out.x += up.x;
  out.y += up.y;
  out.z += (front + rear) / 2 + up.z - box.dz / 2;
  return out;
}

void Profile::lift(std::vector<ObjectState>& states) const {
  if (level()) return;
  for (ObjectState& state : states) {
    if (state.object_class == Class::kPedestrian)
      state.box.z += rise({state.box.x, state.box.y});
    else
      state.box = on_slope(state.box);
    state = rounded(state);
  }
}

}  // namespace infrasim
