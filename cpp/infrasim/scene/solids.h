#pragma once

#include <cstdint>

#include "infrasim/core/geometry.h"
#include "infrasim/core/triangle_mesh.h"

// Builds the solids of which bodies are made. A solid is closed and shares no vertices with other
// solids in the mesh. Its triangles are clockwise seen from outside, as in all bodies.

namespace infrasim {

/// An upright ellipsoid, metres. `lean` is the length by which the top of the ellipsoid is shifted
/// forwards and its bottom backwards.
struct Ellipsoid {
  Vec3 centre;
  Vec3 radii;
  double lean = 0;
};

/// Adds an ellipsoid with `bands` from pole to pole and `sectors` around the axis. The ellipsoid is
/// slightly enlarged, so that on average it hides the same area as the exact ellipsoid.
void add_ellipsoid(TriangleMesh& mesh, const Ellipsoid& e, int bands, int sectors);

/// Adds the rim and tyre of a wheel, upright and along x: a ring with a triangular section.
/// @param depth radial depth of the ring, metres
void add_ring(TriangleMesh& mesh, Vec3 centre, double radius, double depth, double width,
              int segments);

/// Adds a straight bar with `sides` sides, given by the centres of its ends. The bar must not be
/// parallel to z.
void add_bar(TriangleMesh& mesh, Vec3 from, Vec3 to, double radius, int sides);

/// Adds a vertex and returns its number.
std::uint32_t add_vertex(TriangleMesh& mesh, Vec3 p);

/// Adds the triangles between two closed lines of n vertices each. The lines begin at the vertices
/// a and b.
void join(TriangleMesh& mesh, std::uint32_t a, std::uint32_t b, std::uint32_t n);

/// Returns the body moved and scaled to the unit box [-0.5, 0.5]^3, so that it touches all six
/// faces.
TriangleMesh in_unit_box(TriangleMesh mesh);

}  // namespace infrasim
