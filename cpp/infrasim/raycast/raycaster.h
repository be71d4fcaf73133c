#pragma once

#include <memory>
#include <span>

#include "infrasim/core/geometry.h"
#include "infrasim/core/rays.h"
#include "infrasim/core/triangle_mesh.h"
#include "infrasim/raycast/moving_bodies.h"
#include "infrasim/raycast/volumes.h"

struct RTCDeviceTy;

namespace infrasim {

/// Pose of a sensor in the frame of a mesh library.
struct CastOrigin {
  Vec3 position;
  double yaw = 0;
  Horizon horizon;  ///< upper limit of the elevation of the background
};

/// Meshes that do not change during a run; shared by the raycasters of all mounts and threads.
class MeshLibrary {
 public:
  /// @param background triangles with a class each, in the frame of the library
  /// @param bodies     meshes in the unit box
  /// @throws std::runtime_error if Embree rejects a mesh
  MeshLibrary(const TriangleMesh& background, std::span<const TriangleMesh> bodies);

  /// Returns the origin of rays, with the horizon of the background there.
  CastOrigin origin(Vec3 position = {}, double yaw = 0) const;
  ~MeshLibrary();
  MeshLibrary(MeshLibrary&&) noexcept;
  MeshLibrary(const MeshLibrary&) = delete;
  MeshLibrary& operator=(const MeshLibrary&) = delete;

  RTCDeviceTy* device() const;

 private:
  friend class Raycaster;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Finds the nearest hits of rays from the origin of a sensor's levelled frame. The class is not
/// thread-safe. Functions that cast throw std::runtime_error if Embree reports an error.
class Raycaster {
 public:
  Raycaster(const MeshLibrary& library, const CastOrigin& origin);
  /// Makes a raycaster at the origin of the library's frame.
  explicit Raycaster(const MeshLibrary& library) : Raycaster(library, library.origin()) {}
  ~Raycaster();
  Raycaster(const Raycaster&) = delete;
  Raycaster& operator=(const Raycaster&) = delete;

  /// Sets the moving bodies of a frame that lasts `period_s`.
  void set_bodies(std::span<const MovingBody> bodies, double period_s);

  /// Returns the upper limit of the elevation of everything in the scene.
  const Horizon& horizon() const;

  /// Returns the index of moving bodies by the directions that they cover during the frame.
  const BodyIndex& bodies() const;

  /// Finds the nearest hit of each ray in `order`, at the ray's own time. Rays are cast in packets
  /// of 16 in that order, but the hits do not depend on the order. Rays that are not in `order`
  /// become misses. If several hits are equally near, a hit on the background has priority over
  /// hits on bodies, and a body with a lower index has priority over other bodies.
  /// @param incidence whether to fill hits.cos_incidence, and hits.place for bodies
  void cast(const RayBatch& rays, std::span<const std::uint32_t> order, HitBatch& hits,
            bool incidence = true);

  /// Like cast(), but only with the background.
  void cast_background(const RayBatch& rays, std::span<const std::uint32_t> order, HitBatch& hits,
                       bool incidence = true);

  /// Replaces the hit of each ray in `order` if a body is nearer. The class of the background in
  /// the hit does not change.
  void cast_bodies(const RayBatch& rays, std::span<const std::uint32_t> order, HitBatch& hits,
                   bool incidence = true);

  /// Sets `near` to the rays whose cone may meet a body before the ray's hit. The rays keep their
  /// order in `order`.
  /// @param range  range of each ray's hit; +inf if there is no hit
  /// @param spread tangent of half the cone's angle
  /// @param from_m bodies that stay nearer than this during the whole frame do not count
  void near_bodies(const RayBatch& rays, std::span<const std::uint32_t> order,
                   std::span<const float> range, float spread, float from_m,
                   std::vector<std::uint32_t>& near) const;

  /// Returns the visible share of a body at mid-frame. 8 x 8 rays are cast through the rectangle of
  /// azimuth and elevation that contains the body's box. The visible share is the number of rays
  /// that reach the body first, divided by the number of rays that would hit the body if there were
  /// no other objects. Each ray that reaches the body is weighted by the transmission of the leaves
  /// on its path. The share is 0 if no ray would hit the body.
  double visibility(std::size_t index, const Volumes& leaves);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace infrasim
