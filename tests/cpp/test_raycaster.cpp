#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "infrasim/core/classes.h"
#include "infrasim/core/geometry.h"
#include "infrasim/raycast/embree.h"
#include "infrasim/raycast/raycaster.h"
#include "infrasim/scene/vehicle_body.h"

namespace infrasim {
namespace {

constexpr double kPeriod = 0.1;

std::vector<TriangleMesh> bodies(Detail detail) {
  std::vector<TriangleMesh> out;
  for (const ObjectClass& row : kObjectClasses) out.push_back(build_vehicle_body(row.id, detail));
  return out;
}

TriangleMesh triangles(const std::vector<std::array<Vec3, 3>>& list) {
  TriangleMesh mesh;
  for (const auto& corners : list) {
    const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
    for (const Vec3& p : corners)
      mesh.vertices.push_back(
          {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)});
    mesh.triangles.push_back({first, first + 1, first + 2});
    mesh.class_id.push_back(static_cast<std::uint16_t>(mesh.class_id.size()));
  }
  return mesh;
}

/// Returns an upright rectangle across the view at a distance along x, from y0 to y1.
TriangleMesh wall(double x, double y0, double y1) {
  const Vec3 a{x, y0, -50}, b{x, y1, -50}, c{x, y1, 50}, d{x, y0, 50};
  return triangles({{a, b, c}, {a, c, d}});
}

MovingBody still(const Box3d& box, int body = 0) { return {body, box, box}; }

Vec3 direction(double azimuth, double elevation) {
  return {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
          std::sin(elevation)};
}

/// Returns rays with the given directions and firing times (s).
RayBatch ray_batch(const std::vector<Vec3>& directions, const std::vector<double>& times) {
  RayBatch rays;
  rays.resize(directions.size());
  rays.max_range = 200;
  for (std::size_t i = 0; i < directions.size(); ++i) {
    rays.dx[i] = static_cast<float>(directions[i].x);
    rays.dy[i] = static_cast<float>(directions[i].y);
    rays.dz[i] = static_cast<float>(directions[i].z);
    rays.time[i] = static_cast<float>(times[i]);
  }
  return rays;
}

/// Returns rays in random directions at random times. The azimuths cover the whole turn; the
/// elevations are between `low` and `high` (rad).
RayBatch random_rays(std::mt19937& random, int n, double low = -0.5, double high = 0.1) {
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<Vec3> directions;
  std::vector<double> times;
  for (int i = 0; i < n; ++i) {
    directions.push_back(
        direction(2 * kPi * uniform(random), low + (high - low) * uniform(random)));
    times.push_back(kPeriod * uniform(random));
  }
  return ray_batch(directions, times);
}

std::vector<std::uint32_t> in_order(std::size_t n) {
  std::vector<std::uint32_t> order(n);
  std::iota(order.begin(), order.end(), 0U);
  return order;
}

HitBatch cast(Raycaster& raycaster, const RayBatch& rays) {
  HitBatch hits;
  raycaster.cast(rays, in_order(rays.size()), hits);
  return hits;
}

/// Result of casting one ray at a scene of one background and some bodies.
struct Shot {
  float range, cos_incidence;
  int object, class_id;
};
Shot shoot(const TriangleMesh& background, const std::vector<MovingBody>& moving, Vec3 towards,
           double time = 0) {
  const MeshLibrary library(background, bodies(Detail::kBox));
  Raycaster raycaster(library);
  raycaster.set_bodies(moving, kPeriod);
  const HitBatch h = cast(raycaster, ray_batch({towards}, {time}));
  return {h.range[0], h.cos_incidence[0], h.object[0], h.class_id[0]};
}

// --- oracle: a loop over all triangles in double precision ------------------------------------

struct OracleWorld {
  TriangleMesh background;
  std::vector<TriangleMesh> meshes;
  std::vector<MovingBody> moving;
};

struct OracleHit {
  double range = kInf;
  int object = -1;
};

/// Returns the range at which a ray from the origin meets a triangle (Moeller and Trumbore 1997).
double range_to_triangle(Vec3 d, Vec3 a, Vec3 b, Vec3 c) {
  const auto cross3 = [](Vec3 p, Vec3 q) {
    return Vec3{p.y * q.z - p.z * q.y, p.z * q.x - p.x * q.z, p.x * q.y - p.y * q.x};
  };
  const Vec3 e1 = b - a, e2 = c - a, s = -1 * a, p = cross3(d, e2), q = cross3(s, e1);
  const double det = dot(e1, p);
  const double u = dot(s, p) / det, v = dot(d, q) / det, range = dot(e2, q) / det;
  return u >= 0 && v >= 0 && u + v <= 1 && range > 0 ? range : kInf;
}

OracleHit oracle(const OracleWorld& world, Vec3 d, double u) {
  OracleHit best;
  const auto meet = [&](const TriangleMesh& mesh, int object, const auto& to_level) {
    for (const auto& t : mesh.triangles) {
      std::array<Vec3, 3> p;
      for (std::size_t i = 0; i < 3; ++i) {
        const auto& v = mesh.vertices[t.at(i)];
        p.at(i) = to_level(Vec3{v[0], v[1], v[2]});
      }
      const double range = range_to_triangle(d, p[0], p[1], p[2]);
      if (range < best.range) best = {range, object};
    }
  };
  meet(world.background, -1, [](Vec3 p) { return p; });
  for (std::size_t i = 0; i < world.moving.size(); ++i) {
    const auto& [body, from, to] = world.moving[i];
    const double heading = from.heading + u * wrap_angle(to.heading - from.heading);
    const Vec3 centre =
        Vec3{from.x, from.y, from.z} + u * (Vec3{to.x, to.y, to.z} - Vec3{from.x, from.y, from.z});
    const Mat3 turn = rotation(heading, 0, 0);
    meet(world.meshes[body], static_cast<int>(i),
         [&](Vec3 p) { return centre + turn * Vec3{from.dx * p.x, from.dy * p.y, from.dz * p.z}; });
  }
  return best;
}

bool agree(const OracleHit& truth, double range, int object) {
  if (std::isinf(truth.range) || std::isinf(range)) return truth.range == range;
  return truth.object == object && std::abs(truth.range - range) <= 1e-3;
}

/// Returns true if the ray passes an edge, so that the hits agree after a rotation of the ray by
/// 1e-5 rad.
bool grazes(const OracleWorld& world, Vec3 d, double u, double range, int object) {
  for (const Vec3 shift : {Vec3{1e-5, 0, 0}, Vec3{-1e-5, 0, 0}, Vec3{0, 1e-5, 0}, Vec3{0, -1e-5, 0},
                           Vec3{0, 0, 1e-5}, Vec3{0, 0, -1e-5}}) {
    const OracleHit near = oracle(world, d + shift, u);
    if (std::isinf(near.range) == std::isinf(range) && near.object == object) return true;
  }
  return false;
}

OracleWorld random_world(std::mt19937& random) {
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  OracleWorld world;
  world.meshes = bodies(Detail::kLow);
  std::vector<std::array<Vec3, 3>> background;
  for (int i = 0; i < 30; ++i) {
    const Vec3 centre = uniform(30, 120) * direction(uniform(-kPi, kPi), uniform(-0.4, 0.2));
    const auto corner = [&] {
      return centre + Vec3{uniform(-15, 15), uniform(-15, 15), uniform(-8, 8)};
    };
    background.push_back({corner(), corner(), corner()});
  }
  world.background = triangles(background);
  for (int i = 0; i < 8; ++i) {
    const double azimuth = uniform(-kPi, kPi), distance = uniform(8, 30);
    const Box3d from{distance * std::cos(azimuth),
                     distance * std::sin(azimuth),
                     uniform(-6, 1),
                     uniform(2, 14),
                     uniform(1, 3),
                     uniform(1, 4),
                     uniform(-kPi, kPi)};
    Box3d to = from;
    to.x += uniform(-4, 4);
    to.y += uniform(-4, 4);
    to.z += uniform(-0.3, 0.3);
    to.heading = wrap_angle(to.heading + uniform(-1, 1));
    world.moving.push_back({i % 7, from, to});
  }
  return world;
}

TEST(raycaster, agrees_with_a_loop_over_all_triangles) {
  const unsigned seed = 20;
  SCOPED_TRACE(seed);
  std::mt19937 random(seed);
  int rays = 0, hits_on_bodies = 0, grazing = 0;
  for (int scene = 0; scene < 4; ++scene) {
    const OracleWorld world = random_world(random);
    const MeshLibrary library(world.background, world.meshes);
    Raycaster raycaster(library);
    raycaster.set_bodies(world.moving, kPeriod);
    const RayBatch batch = random_rays(random, 1500);
    const HitBatch hits = cast(raycaster, batch);
    for (std::size_t i = 0; i < batch.size(); ++i) {
      const Vec3 d{batch.dx[i], batch.dy[i], batch.dz[i]};
      const double u = batch.time[i] / kPeriod;
      const OracleHit truth = oracle(world, d, u);
      ++rays;
      hits_on_bodies += truth.object >= 0;
      if (agree(truth, hits.range[i], hits.object[i])) continue;
      ++grazing;
      EXPECT_TRUE(grazes(world, d, u, hits.range[i], hits.object[i]))
          << "scene " << scene << " ray " << i << ": range " << hits.range[i] << " object "
          << hits.object[i] << ", the loop says " << truth.range << " and " << truth.object;
    }
  }
  EXPECT_GT(hits_on_bodies, rays / 20);
  EXPECT_LE(grazing, rays / 1000);
}

// --- what a caller relies on ------------------------------------------------------------------

TEST(raycaster, hits_do_not_depend_on_the_order_of_the_rays) {
  std::mt19937 random(21);
  const OracleWorld world = random_world(random);
  const MeshLibrary library(world.background, world.meshes);
  Raycaster raycaster(library);
  raycaster.set_bodies(world.moving, kPeriod);
  const RayBatch rays = random_rays(random, 5003);
  const HitBatch first = cast(raycaster, rays);
  auto order = in_order(rays.size());
  for (int repeat = 0; repeat < 3; ++repeat) {
    std::shuffle(order.begin(), order.end(), random);
    HitBatch other;
    raycaster.cast(rays, order, other);
    EXPECT_TRUE(other.range == first.range);
    EXPECT_TRUE(other.object == first.object);
    for (std::size_t i = 0; i < rays.size(); ++i) {
      if (std::isinf(first.range[i])) continue;
      ASSERT_EQ(other.cos_incidence[i], first.cos_incidence[i]);
      ASSERT_EQ(other.class_id[i], first.class_id[i]);
    }
  }
}

TEST(raycaster, rays_that_are_not_named_are_misses) {
  const MeshLibrary library(wall(10, -5, 5), bodies(Detail::kBox));
  Raycaster raycaster(library);
  raycaster.set_bodies({}, kPeriod);
  const RayBatch rays = ray_batch({{1, 0, 0}, {1, 0, 0}, {1, 0, 0}}, {0, 0, 0});
  HitBatch hits;
  raycaster.cast(rays, std::array{1U}, hits);
  EXPECT_EQ(hits.range, (std::vector<float>{HUGE_VALF, 10.F, HUGE_VALF}));
}

TEST(raycaster, a_wall_at_10_m_is_at_10_m) {
  const Shot shot = shoot(wall(10, -5, 5), {}, {1, 0, 0});
  EXPECT_NEAR(shot.range, 10, 1e-5);
  EXPECT_EQ(shot.object, -1);
  EXPECT_NEAR(shot.cos_incidence, 1, 1e-6);
}

TEST(raycaster, a_hit_on_the_background_has_the_class_of_its_triangle) {
  const TriangleMesh two = triangles(
      {{{{10, 0, 0}, {10, -5, 5}, {10, -5, -5}}}, {{{10, 0, 0}, {10, 5, 5}, {10, 5, -5}}}});
  EXPECT_EQ(shoot(two, {}, direction(-0.2, 0)).class_id, 0);
  EXPECT_EQ(shoot(two, {}, direction(0.2, 0)).class_id, 1);
}

TEST(raycaster, leaves_the_arithmetic_of_its_caller_as_it_is) {
  volatile float smallest = std::numeric_limits<float>::min();
  shoot(wall(10, -5, 5), {still({5, 0, 0, 4, 2, 2, 0})}, {1, 0, 0});
  const float denormal = smallest / 2;
  EXPECT_GT(denormal, 0.0F);
  EXPECT_EQ(std::fpclassify(denormal), FP_SUBNORMAL);
}

TEST(raycaster, an_empty_scene_gives_misses) {
  const Shot shot = shoot({}, {}, {1, 0, 0});
  EXPECT_TRUE(std::isinf(shot.range));
  EXPECT_EQ(shot.object, -1);
}

TEST(raycaster, a_hit_beyond_the_longest_range_is_a_miss) {
  EXPECT_FALSE(std::isinf(shoot(wall(199.9, -5, 5), {}, {1, 0, 0}).range));
  EXPECT_TRUE(std::isinf(shoot(wall(200.1, -5, 5), {}, {1, 0, 0}).range));
}

TEST(raycaster, the_nearest_of_several_bodies_is_hit) {
  const std::vector moving{still({30, 0, 0, 4, 2, 2, 0}), still({20, 0, 0, 4, 2, 2, 0}, 1)};
  const Shot shot = shoot(wall(50, -9, 9), moving, {1, 0, 0});
  EXPECT_EQ(shot.object, 1);
  EXPECT_NEAR(shot.range, 18, 1e-4);
}

TEST(raycaster, a_body_that_moves_out_of_the_way_is_hit_only_before) {
  const MovingBody leaving{0, {20, 0, 0, 4, 2, 2, 0}, {20, 5, 0, 4, 2, 2, 0}};
  EXPECT_NEAR(shoot({}, {leaving}, {1, 0, 0}, 0).range, 18, 1e-4);
  EXPECT_NEAR(shoot({}, {leaving}, {1, 0, 0}, 0.19 * kPeriod).range, 18, 1e-4);
  EXPECT_TRUE(std::isinf(shoot({}, {leaving}, {1, 0, 0}, 0.21 * kPeriod).range));
  EXPECT_TRUE(std::isinf(shoot({}, {leaving}, {1, 0, 0}, kPeriod).range));
}

TEST(raycaster, a_body_that_comes_nearer_is_met_where_it_is_at_the_rays_time) {
  const MovingBody coming{0, {22, 0, 0, 4, 2, 2, 0}, {20, 0, 0, 4, 2, 2, 0}};
  for (const double u : {0.0, 0.3, 0.5, 1.0})
    EXPECT_NEAR(shoot({}, {coming}, {1, 0, 0}, u * kPeriod).range, 20 - 2 * u, 1e-4) << u;
}

TEST(raycaster, a_body_turns_the_short_way) {
  // The heading changes from 170 to -170 degrees. At half time the body is along the ray; on the
  // longer way it would be across the ray.
  const MovingBody turning{0, {20, 0, 0, 6, 2, 2, rad(170)}, {20, 0, 0, 6, 2, 2, rad(-170)}};
  EXPECT_NEAR(shoot({}, {turning}, {1, 0, 0}, kPeriod / 2).range, 17, 1e-4);
}

TEST(raycaster, incidence_is_the_cosine_to_the_surface) {
  for (const double turn : {0.0, 20.0, 40.0, -35.0}) {
    const Shot shot = shoot({}, {still({20, 0, 0, 8, 6, 2, rad(turn)})}, {1, 0, 0});
    const bool front = std::abs(std::tan(rad(turn))) < 6.0 / 8;
    const double wanted = front ? std::cos(rad(turn)) : std::abs(std::sin(rad(turn)));
    EXPECT_NEAR(shot.cos_incidence, wanted, 1e-4) << turn;
  }
  // The ray looks down at a roof of 2 m height whose centre is 6 m below.
  const Vec3 down = direction(0, -rad(20));
  const Shot roof = shoot({}, {still({5 / std::tan(rad(20)), 0, -6, 9, 3, 2, 0.4})}, down);
  EXPECT_NEAR(roof.cos_incidence, std::sin(rad(20)), 1e-4);
  EXPECT_NEAR(shoot(wall(10, -9, 9), {}, direction(0.5, 0)).cos_incidence, std::cos(0.5), 1e-5);
}

TEST(raycaster, incidence_follows_a_body_that_turns) {
  // 5 degrees per frame is faster than vehicles turn. The raycaster uses the heading at mid-frame.
  const MovingBody turning{0, {20, 0, 0, 8, 6, 2, rad(30)}, {20, 0, 0, 8, 6, 2, rad(35)}};
  for (const double u : {0.0, 0.5, 1.0})
    EXPECT_NEAR(shoot({}, {turning}, {1, 0, 0}, u * kPeriod).cos_incidence,
                std::cos(rad(30 + 5 * u)), std::abs(u - 0.5) * rad(5) + 1e-4);
}

TEST(raycaster, nothing_is_hit_above_the_horizon) {
  std::mt19937 random(23);
  int above = 0;
  for (int scene = 0; scene < 10; ++scene) {
    const OracleWorld world = random_world(random);
    const MeshLibrary library(world.background, world.meshes);
    Raycaster raycaster(library);
    raycaster.set_bodies(world.moving, kPeriod);
    const RayBatch rays = random_rays(random, 4000, -0.2, 1);
    const HitBatch hits = cast(raycaster, rays);
    for (std::size_t i = 0; i < rays.size(); ++i) {
      if (raycaster.horizon().covers(rays.dx[i], rays.dy[i], rays.dz[i])) continue;
      ++above;
      EXPECT_TRUE(std::isinf(hits.range[i])) << scene << " " << i;
    }
  }
  EXPECT_GT(above, 10000);
}

/// Returns the corners of a prism's outline. If `behind` is true, one corner is exactly behind the
/// sensor.
std::array<Vec2, 4> random_outline(std::mt19937& random, bool behind) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  const double heading = kPi * uniform(random);
  const Vec2 centre = (30 + 25 * uniform(random)) * heading_vector(kPi * uniform(random));
  std::array<Vec2, 4> outline = footprint({centre.x, centre.y, 0, 3, 1, 1, heading});
  if (behind) {
    const Vec2 shift = Vec2{-10, 0} - outline[0];
    for (Vec2& corner : outline) corner = corner + shift;
    outline[0].y = 0;
  }
  return outline;
}

TEST(horizon, covers_all_whose_cone_reaches_into_a_view) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(-1, 1);
  int level = 0;
  for (int i = 0; i < 2000; ++i) {
    const auto outline = random_outline(random, i % 4 == 0);
    const double top = 40 * std::abs(uniform(random));
    Horizon horizon;
    for (const ViewBounds& view : view_of(outline, 0, top)) horizon.add(view);
    for (const double half_deg : {0.0, 0.1, 1.0, 5.0})
      for (const Vec2& corner : outline) {
        // A ray to a corner. The axis of the cone differs from the ray by half the cone's angle, in
        // any direction.
        const double length = std::hypot(norm(corner), top), turn = kPi * uniform(random);
        const Vec3 ray{corner.x / length, corner.y / length, top / length};
        const Vec3 level_side{-corner.y / norm(corner), corner.x / norm(corner), 0};
        const Vec3 side = std::cos(turn) * level_side + std::sin(turn) * cross(ray, level_side);
        const Vec3 axis = std::cos(rad(half_deg)) * ray + std::sin(rad(half_deg)) * side;
        const auto covers = [&](double spread) {
          return horizon.covers(static_cast<float>(axis.x), static_cast<float>(axis.y),
                                static_cast<float>(axis.z), static_cast<float>(spread));
        };
        EXPECT_TRUE(covers(std::tan(rad(half_deg)) + 1e-6 * half_deg)) << i << " " << half_deg;
        level += covers(0) ? 0 : 1;
      }
  }
  EXPECT_GT(level, 1000);  // number of cones that meet the body although their axis does not
}

TEST(raycaster, a_wall_that_ends_at_180_degrees_is_seen_at_minus_180_degrees) {
  const Vec3 a{-10, 0, -5}, b{-10, 5, -5}, c{-10, 5, 5}, d{-10, 0, 5};
  const MeshLibrary library(triangles({{a, b, c}, {a, c, d}}), bodies(Detail::kBox));
  const Raycaster raycaster(library);
  for (const float y : {0.0F, -0.0F, 1e-8F, -1e-8F, -1e-7F})
    EXPECT_TRUE(raycaster.horizon().covers(-1, y, 0.1F)) << y;
  EXPECT_FALSE(raycaster.horizon().covers(-1, -0.1F, 0.1F));
}

TEST(embree_error, is_kept_until_it_is_asked_for_and_passes_through_no_function_of_embree) {
  EmbreeError error;
  const RTCDevice device = rtcNewDevice("threads=1,set_affinity=0");
  error.watch(device);
  error.check();
  bool came_back = false;
  try {
    EXPECT_EQ(rtcNewGeometry(device, static_cast<RTCGeometryType>(99)), nullptr);
    EXPECT_EQ(rtcNewGeometry(device, static_cast<RTCGeometryType>(98)), nullptr);
    came_back = true;
    error.check();
    ADD_FAILURE() << "no error";
  } catch (const std::runtime_error& e) {
    EXPECT_TRUE(std::string(e.what()).starts_with("Embree error 1: ")) << e.what();
  }
  EXPECT_TRUE(came_back);
  rtcReleaseDevice(device);
}

TEST(raycaster, an_error_of_embree_after_the_build_is_an_exception_and_no_miss) {
  const MeshLibrary library(wall(10, -5, 5), bodies(Detail::kBox));
  Raycaster caster(library);
  const RayBatch rays = ray_batch({{1, 0, 0}}, {0});
  const std::vector<std::uint32_t> order{0};
  HitBatch hits;
  caster.cast(rays, order, hits);
  EXPECT_EQ(rtcNewGeometry(library.device(), static_cast<RTCGeometryType>(99)), nullptr);
  EXPECT_THROW(caster.cast(rays, order, hits), std::runtime_error);
  EXPECT_THROW(caster.cast_background(rays, order, hits), std::runtime_error);
  EXPECT_THROW(caster.cast_bodies(rays, order, hits), std::runtime_error);
}

TEST(raycaster, horizon_is_level_where_nothing_rises) {
  const MeshLibrary library(triangles({{{{-90, -90, -5}, {90, -90, -5}, {0, 90, -5}}}}),
                            bodies(Detail::kBox));
  Raycaster raycaster(library);
  EXPECT_TRUE(raycaster.horizon().covers(1, 0, 0));
  EXPECT_FALSE(raycaster.horizon().covers(1, 0, 0.001F));
  EXPECT_TRUE(raycaster.horizon().covers(1, 0, 0.001F, 0.002F));
  raycaster.set_bodies(std::vector{still({20, 0, 1, 4, 2, 2, 0})}, kPeriod);
  EXPECT_TRUE(raycaster.horizon().covers(1, 0, 0.1F));
  EXPECT_FALSE(raycaster.horizon().covers(-1, 0, 0.1F));
}

TEST(raycaster, turning_scene_and_sensor_together_changes_no_range) {
  std::mt19937 random(22);
  const OracleWorld world = random_world(random);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<Vec3> directions;
  std::vector<double> times;
  for (int i = 0; i < 4000; ++i) {
    directions.push_back(direction(2 * kPi * uniform(random), 0.6 * uniform(random) - 0.5));
    times.push_back(kPeriod * uniform(random));
  }
  const double yaw = 2.1;
  const Mat3 turn = rotation(yaw, 0, 0);
  const auto ranges = [&](const OracleWorld& w, const std::vector<Vec3>& rays) {
    const MeshLibrary library(w.background, w.meshes);
    Raycaster raycaster(library);
    raycaster.set_bodies(w.moving, kPeriod);
    return cast(raycaster, ray_batch(rays, times)).range;
  };
  OracleWorld turned = world;
  for (auto& v : turned.background.vertices) {
    const Vec3 p = turn * Vec3{v[0], v[1], v[2]};
    v = {static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z)};
  }
  for (MovingBody& body : turned.moving)
    for (Box3d* box : {&body.from, &body.to}) {
      const Vec3 p = turn * Vec3{box->x, box->y, box->z};
      box->x = p.x;
      box->y = p.y;
      box->heading = wrap_angle(box->heading + yaw);
    }
  std::vector<Vec3> turned_rays;
  for (const Vec3& d : directions) turned_rays.push_back(turn * d);
  const auto before = ranges(world, directions), after = ranges(turned, turned_rays);
  int changed = 0;  // rays along an edge may be assigned to its other side
  for (std::size_t i = 0; i < before.size(); ++i)
    changed += before[i] != after[i] && !(std::abs(before[i] - after[i]) <= 1e-3F);
  EXPECT_LE(changed, 4);
}

// --- visibility -------------------------------------------------------------------------------

double visibility(const TriangleMesh& background, const std::vector<MovingBody>& moving) {
  const MeshLibrary library(background, bodies(Detail::kLow));
  Raycaster raycaster(library);
  raycaster.set_bodies(moving, kPeriod);
  return raycaster.visibility(0, {});
}

TEST(visibility, of_a_lone_body_is_1_wherever_it_stands) {
  for (const double azimuth : {0.0, 1.0, 3.1, -3.1, -1.6})
    for (const double distance : {5.0, 30.0, 200.0})
      for (int body = 0; body < 7; ++body) {
        const Box3d box{
            distance * std::cos(azimuth), distance * std::sin(azimuth), -5, 4.5, 2, 1.5, 0.3};
        EXPECT_EQ(visibility({}, {still(box, body)}), 1) << azimuth << " " << distance;
      }
}

TEST(visibility, of_a_body_under_the_sensor_is_1) {
  EXPECT_EQ(visibility({}, {still({0.5, 0.2, -5, 4.5, 2, 1.5, 0.3})}), 1);
}

TEST(visibility, of_a_body_behind_a_wall_is_0_and_before_it_1) {
  const MovingBody body = still({30, 0, 0, 4.5, 2, 1.5, 0.3});
  EXPECT_EQ(visibility(wall(20, -20, 20), {body}), 0);
  EXPECT_EQ(visibility(wall(40, -20, 20), {body}), 1);
}

TEST(visibility, of_a_body_half_behind_a_wall_is_about_a_half) {
  EXPECT_NEAR(visibility(wall(20, 0, 20), {still({30, 0, 0, 4.5, 2, 1.5, 0})}), 0.5, 0.1);
}

TEST(visibility, is_lowered_by_other_bodies) {
  const MovingBody body = still({30, 0, 0, 4.5, 2, 1.5, 0});
  EXPECT_EQ(visibility({}, {body, still({20, 0, 0, 4.5, 3, 3, 0}, 3)}), 0);
  EXPECT_EQ(visibility({}, {body, still({40, 0, 0, 4.5, 3, 3, 0}, 3)}), 1);
}

TEST(visibility, is_that_at_the_middle_of_the_frame) {
  // The vehicle is behind the wall's edge at the start of the frame, and before it at the end.
  const MovingBody passing{0, {30, 2, 0, 4.5, 2, 1.5, 0}, {30, -2, 0, 4.5, 2, 1.5, 0}};
  EXPECT_NEAR(visibility(wall(20, 0, 20), {passing}), 0.5, 0.1);
}

}  // namespace
}  // namespace infrasim
