#pragma once

#include <memory>
#include <span>

#include "infrasim/core/geometry.h"
#include "infrasim/core/rays.h"
#include "infrasim/core/triangle_mesh.h"
#include "infrasim/raycast/moving_bodies.h"
#include "infrasim/raycast/volumes.h"

namespace infrasim {

/// Meshes that do not change during a run; shared by the raycasters of all threads.
class MeshLibrary {
 public:
  /// @param background triangles with a class each
  /// @param bodies     meshes in the unit box
  /// @throws std::runtime_error if Embree rejects a mesh
  MeshLibrary(const TriangleMesh& background, std::span<const TriangleMesh> bodies);
  ~MeshLibrary();
  MeshLibrary(const MeshLibrary&) = delete;
  MeshLibrary& operator=(const MeshLibrary&) = delete;

 private:
  friend class Raycaster;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Nearest hits of rays from the origin of the levelled frame. Not thread-safe.
class Raycaster {
 public:
  explicit Raycaster(const MeshLibrary& library);
  ~Raycaster();
  Raycaster(const Raycaster&) = delete;
  Raycaster& operator=(const Raycaster&) = delete;

  /// Sets the moving bodies of a frame that lasts `period_s`.
  void set_bodies(std::span<const MovingBody> bodies, double period_s);

  /// Upper limit of the elevation of everything in the scene.
  const Horizon& horizon() const;

  /// Views of the bodies during the frame.
  const BodyIndex& bodies() const;

  /// Nearest hit of each ray in `order`, each at its own time, in packets of 16 in that order. The
  /// other rays become misses. The hits do not depend on the order. Between equally near hits the
  /// background wins, then the lowest index.
  /// @param incidence whether to fill hits.cos_incidence, and hits.place for bodies
  void cast(const RayBatch& rays, std::span<const std::uint32_t> order, HitBatch& hits,
            bool incidence = true);

  /// As cast, with the background alone.
  void cast_background(const RayBatch& rays, std::span<const std::uint32_t> order, HitBatch& hits,
                       bool incidence = true);

  /// Replaces the hits of the rays in `order` if a body is nearer. The hits keep the class of the
  /// background.
  void cast_bodies(const RayBatch& rays, std::span<const std::uint32_t> order, HitBatch& hits,
                   bool incidence = true);

  /// Visible share of a body at mid-frame, by 8 x 8 rays through the angular rectangle of its box.
  /// Of the rays that hit the body when it is alone, it is the share that reach it first, each
  /// weighted by the transmission of leaves. 0 if no ray hits it alone.
  double visibility(std::size_t index, const Volumes& leaves);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace infrasim
