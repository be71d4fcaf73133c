#pragma once

#include <memory>
#include <span>

#include "infrasim/core/geometry.h"
#include "infrasim/core/rays.h"
#include "infrasim/core/triangle_mesh.h"

namespace infrasim {

/// A body of the library, scaled to its box and moving over one frame; levelled frame.
struct MovingBody {
  int body = 0;
  Box3d from;
  Box3d to;
};

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

  /// Sets the moving bodies: position linear in time, heading the short way, over `period_s`.
  /// @throws std::runtime_error if Embree fails to build the scene
  void set_bodies(std::span<const MovingBody> bodies, double period_s);

  /// Highest z of everything in the scene, levelled frame; -inf for an empty one.
  float top() const;

  /// Nearest hit of each ray that `order` names, every ray at its own time; packets of 16 in that
  /// order. The others are misses. The hits do not depend on the order.
  /// @param incidence fill hits.cos_incidence too
  void cast(const RayBatch& rays, std::span<const std::uint32_t> order, HitBatch& hits,
            bool incidence = true);

  /// Of 8 x 8 rays through the box's angular rectangle at mid-frame that hit the body alone, the
  /// share that reach it first; 0 if none hits it alone.
  double visibility(std::size_t index);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace infrasim
