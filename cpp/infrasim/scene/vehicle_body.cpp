#include "infrasim/scene/vehicle_body.h"

#include <algorithm>
#include <span>

#include "infrasim/scene/person_body.h"
#include "infrasim/scene/solids.h"

namespace infrasim {

namespace {

constexpr double kBodyGap = 0.001;  // metres by which a body is shorter than its box on each axis

/// A cross-section of a body: its position along the length (-0.5 at the rear, 0.5 at the front),
/// its width and its height, all as shares of the size of the box.
struct Station {
  double x, width, height;
};

/// A body lofted through cross-sections from rear to front. Above the belt line, the body narrows
/// to the roof.
struct Silhouette {
  std::span<const Station> stations;
  double belt = 1;
  double roof_width = 1;
};

constexpr Station kCarStations[] = {{-.50, .86, .60}, {-.45, 1, .68}, {-.34, 1, .92},
                                    {-.22, 1, 1.0},   {.04, 1, 1.0},  {.22, 1, .63},
                                    {.44, 1, .54},    {.50, .80, .42}};
constexpr Station kVanStations[] = {{-.50, .96, .94}, {-.47, 1, 1.0}, {.16, 1, 1.0},
                                    {.34, 1, .62},    {.46, 1, .52},  {.50, .84, .42}};
constexpr Station kTruckStations[] = {{-.50, 1, 1.0},  {.18, 1, 1.0},   {.20, .94, .84},
                                      {.44, .94, .82}, {.49, .94, .50}, {.50, .92, .46}};
constexpr Station kBusStations[] = {
    {-.50, .97, .95}, {-.48, 1, 1.0}, {.46, 1, 1.0}, {.50, .95, .90}};
constexpr Station kRiderStations[] = {{-.50, .22, .38}, {-.38, .40, .56}, {-.22, .80, .92},
                                      {-.02, 1, 1.0},   {.08, .86, .88},  {.20, .96, .64},
                                      {.34, .30, .56},  {.50, .22, .36}};

Silhouette silhouette_of(Class object_class) {
  switch (object_class) {
    case Class::kVan:
      return {kVanStations, .50, .84};
    case Class::kTruck:
      return {kTruckStations, 1, 1};
    case Class::kBus:
      return {kBusStations, .50, .94};
    case Class::kMotorcycle:
      return {kRiderStations, .60, .55};
    default:
      return {kCarStations, .58, .76};
  }
}

struct Resolution {
  int between_stations;  ///< number of cross-sections added between two stations
  int corner;            ///< number of points that round each corner of a cross-section
};

Resolution resolution_of(Detail detail) {
  switch (detail) {
    case Detail::kMid:
      return {1, 3};
    case Detail::kFine:
      return {9, 10};
    default:
      return {0, 1};
  }
}

/// Interpolates smoothly between two stations. Finer levels of detail have additional
/// cross-sections between the stations.
Station between(const Station& a, const Station& b, double u) {
  const double smooth = u * u * (3 - 2 * u);
  return {a.x + u * (b.x - a.x), a.width + smooth * (b.width - a.width),
          a.height + u * (b.height - a.height)};
}

using Outline = std::vector<Vec2>;  ///< (y, z) of half a cross-section, from the bottom to the top

/// Returns the corners of the left half (y >= 0) of a cross-section, from the bottom to the top.
Outline half_corners(const Silhouette& body, const Station& s) {
  const double above = std::clamp((s.height - body.belt) / (1 - body.belt + 1e-9), 0.0, 1.0);
  const double half = s.width / 2, top = half * (1 - above * (1 - body.roof_width));
  const double belt = std::min(body.belt, .9 * s.height);
  return {{half, -.5}, {half, belt - .5}, {top, .97 * s.height - .5}, {.85 * top, s.height - .5}};
}

/// Rounds corners with quadratic Bezier curves over 30 % of each adjacent side.
Outline rounded_half(const Outline& corners, int points) {
  if (points == 1) return corners;
  Outline out{corners.front()};
  for (std::size_t i = 1; i < corners.size(); ++i) {
    const Vec2 p = corners[i];
    const Vec2 after = i + 1 < corners.size() ? corners[i + 1] : Vec2{0, p.y};
    const Vec2 a = p + .3 * (corners[i - 1] - p), b = p + .3 * (after - p);
    for (int k = 0; k < points; ++k) {
      const double u = static_cast<double>(k) / (points - 1), v = 1 - u;
      out.push_back(v * v * a + 2 * u * v * p + u * u * b);
    }
  }
  return out;
}

class Loft {
 public:
  void add(double x, const Outline& half) {
    for (const Vec2& p : half) add_vertex(mesh_, {x, p.x, p.y});
    for (auto p = half.rbegin(); p != half.rend(); ++p) add_vertex(mesh_, {x, -p->x, p->y});
    if (ring_ > 0) join(mesh_, last_, last_ + ring_, ring_);
    ring_ = static_cast<std::uint32_t>(2 * half.size());
    last_ = static_cast<std::uint32_t>(mesh_.vertices.size()) - ring_;
  }

  TriangleMesh close() {
    for (std::uint32_t i = 1; i + 1 < ring_; ++i) mesh_.triangles.push_back({0, i, i + 1});
    for (std::uint32_t i = 1; i + 1 < ring_; ++i)
      mesh_.triangles.push_back({last_, last_ + i + 1, last_ + i});
    return std::move(mesh_);
  }

 private:
  TriangleMesh mesh_;
  std::uint32_t ring_ = 0;  ///< number of vertices of a cross-section
  std::uint32_t last_ = 0;  ///< first vertex of the last cross-section
};

TriangleMesh unit_box() {
  Loft loft;
  for (const double x : {-.5, .5}) loft.add(x, {{.5, -.5}, {.5, .5}});
  return loft.close();
}

}  // namespace

TriangleMesh build_vehicle_body(Class object_class, Detail detail) {
  if (detail == Detail::kBox) return unit_box();
  if (object_class == Class::kPedestrian) return build_pedestrian(detail);
  if (object_class == Class::kCyclist) return build_cyclist(detail);
  const Silhouette body = silhouette_of(object_class);
  const auto [extra, corner] = resolution_of(detail);
  Loft loft;
  for (std::size_t i = 0; i + 1 < body.stations.size(); ++i)
    for (int k = 0; k <= extra; ++k) {
      const Station s =
          between(body.stations[i], body.stations[i + 1], static_cast<double>(k) / (extra + 1));
      loft.add(s.x, rounded_half(half_corners(body, s), corner));
    }
  const Station& front = body.stations.back();
  loft.add(front.x, rounded_half(half_corners(body, front), corner));
  return loft.close();
}

Box3d body_box(const Box3d& vehicle) {
  Box3d box = vehicle;
  box.dx -= kBodyGap;
  box.dy -= kBodyGap;
  box.dz -= kBodyGap;
  box.z += kBodyGap / 2;
  return box;
}

}  // namespace infrasim
