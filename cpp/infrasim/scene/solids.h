#pragma once

#include "infrasim/core/geometry.h"
#include "infrasim/core/triangle_mesh.h"

// Solids that bodies are put together from. Each is closed, its triangles clockwise seen from
// outside as those of all bodies are, and added to a mesh with vertices of its own.

namespace infrasim {

/// An upright ellipsoid, metres; `lean` moves its top by so much ahead and its bottom back.
struct Ellipsoid {
  Vec3 centre;
  Vec3 radii;
  double lean = 0;
};

/// Of `bands` from pole to pole and `sectors` round the axis; as wide as makes up for its corners,
/// so that it hides as much of what lies behind it as the ellipsoid does, on average.
void add_ellipsoid(TriangleMesh& mesh, const Ellipsoid& e, int bands, int sectors);

/// A wheel's rim and tyre, upright and along x: a ring of triangular section.
/// @param depth from its outside to its inside, metres
void add_ring(TriangleMesh& mesh, Vec3 centre, double radius, double depth, double width,
              int segments);

/// A straight bar of `sides` sides, from one middle of its ends to the other; never along z.
void add_bar(TriangleMesh& mesh, Vec3 from, Vec3 to, double radius, int sides);

/// The same body moved and stretched to the unit box [-0.5, 0.5]^3, whose six faces it touches.
TriangleMesh in_unit_box(TriangleMesh mesh);

}  // namespace infrasim
