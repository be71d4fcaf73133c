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

/// Nearest hits of rays from the origin of the levelled frame. For one thread at a time.
class Raycaster {
 public:
  explicit Raycaster(const MeshLibrary& library);
  ~Raycaster();
  Raycaster(const Raycaster&) = delete;
  Raycaster& operator=(const Raycaster&) = delete;

  /// Sets the moving bodies of a frame of `period_s`.
  void set_bodies(std::span<const MovingBody> bodies, double period_s);

  /// How high anything in the scene is seen.
  const Horizon& horizon() const;

  /// Where bodies can be met during the frame.
  const BodyIndex& bodies() const;

  /// Nearest hit of each ray that `order` names, every ray at its own time; packets of 16 in that
  /// order. The others are misses. The hits do not depend on the order; of equal ones the
  /// background's counts, then that of the lowest index.
  /// @param incidence fill hits.cos_incidence, and hits.place of bodies, too
  void cast(const RayBatch& rays, std::span<const std::uint32_t> order, HitBatch& hits,
            bool incidence = true);

  /// The same with the background alone.
  void cast_background(const RayBatch& rays, std::span<const std::uint32_t> order, HitBatch& hits,
                       bool incidence = true);

  /// Replaces the hits of the rays that `order` names where a body is nearer; their class stays
  /// that of the background.
  void cast_bodies(const RayBatch& rays, std::span<const std::uint32_t> order, HitBatch& hits,
                   bool incidence = true);

  /// Of 8 x 8 rays through the box's angular rectangle at mid-frame that hit the body alone, the
  /// share that reach it first, each by the share that leaves let through; 0 if none hits it alone.
  double visibility(std::size_t index, const Volumes& leaves);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace infrasim
