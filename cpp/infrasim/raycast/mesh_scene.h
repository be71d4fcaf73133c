#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <vector>

#include "infrasim/core/geometry.h"
#include "infrasim/raycast/embree.h"
#include "infrasim/raycast/moving_bodies.h"
#include "infrasim/raycast/packets.h"
#include "infrasim/raycast/raycaster.h"

namespace infrasim {

struct EmbreeRelease {
  void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
  void operator()(RTCGeometry geometry) const { rtcReleaseGeometry(geometry); }
};
using SceneHandle = std::unique_ptr<RTCSceneTy, EmbreeRelease>;
using GeometryHandle = std::unique_ptr<RTCGeometryTy, EmbreeRelease>;

/// The intersection of a ray with the plane of a triangle.
struct PlaneHit {
  float range;
  double ahead;  ///< scalar product of the plane's normal and the ray's direction
};

/// A mesh with its Embree hierarchy. Embree reads the vertices and triangles from these vectors.
struct MeshScene {
  std::vector<std::array<float, 3>> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  SceneHandle scene;

  /// Returns the intersection of a ray with the plane of a triangle. Embree also computes the
  /// range, but its result depends on how the processor approximates reciprocals.
  /// @param normal normal of the triangle, of any length
  /// @param embree range from Embree, used if the ray is parallel to the plane
  PlaneHit hit(std::uint32_t triangle, Vec3 normal, const BodyMotion::UnitRay& ray,
               float embree) const {
    const auto& v = vertices[triangles[triangle][0]];
    const double ahead = dot(normal, Vec3{ray.dx, ray.dy, ray.dz});
    const double range =
        dot(normal, Vec3{v[0] - double{ray.x}, v[1] - double{ray.y}, v[2] - double{ray.z}}) / ahead;
    return {std::isfinite(range) ? static_cast<float>(range) : embree, ahead};
  }
};

/// One packet of rays. The masks and flags are set only once, because Embree does not change them.
struct Packet {
  alignas(64) std::array<int, kPacketRays> valid{};
  RTCRayHit16 rh{};

  Packet() {
    for (unsigned& mask : rh.ray.mask) mask = 0xFFFFFFFFU;
  }

  void set(std::size_t i, const BodyMotion::UnitRay& ray, float tnear, float tfar) {
    rh.ray.org_x[i] = ray.x;
    rh.ray.org_y[i] = ray.y;
    rh.ray.org_z[i] = ray.z;
    rh.ray.dir_x[i] = ray.dx;
    rh.ray.dir_y[i] = ray.dy;
    rh.ray.dir_z[i] = ray.dz;
    rh.ray.tnear[i] = tnear;
    rh.ray.tfar[i] = tfar;
    rh.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
  }

  /// Casts the first `count` rays of the packet.
  void intersect(RTCScene scene, std::size_t count) {
    for (std::size_t i = 0; i < kPacketRays; ++i) valid[i] = i < count ? -1 : 0;
    intersect16(valid.data(), scene, rh);
  }

  bool hit(std::size_t i) const { return rh.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID; }

  /// Returns the hit of `ray`, which is ray `i` of the packet.
  PlaneHit plane_hit(std::size_t i, const MeshScene& mesh, const BodyMotion::UnitRay& ray) const {
    return mesh.hit(rh.hit.primID[i], {rh.hit.Ng_x[i], rh.hit.Ng_y[i], rh.hit.Ng_z[i]}, ray,
                    rh.ray.tfar[i]);
  }
};

struct MeshLibrary::Impl {
  EmbreeError error;
  RTCDevice device = nullptr;
  std::vector<std::uint16_t> background_class;
  std::vector<MeshScene> meshes;  ///< meshes of the bodies, then of the background

  ~Impl() {
    meshes.clear();
    if (device != nullptr) rtcReleaseDevice(device);
  }
};

}  // namespace infrasim
