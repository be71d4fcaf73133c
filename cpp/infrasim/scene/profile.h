#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "infrasim/config/scene_config.h"
#include "infrasim/scene/trajectories.h"

namespace infrasim {

/// Triangles in double precision; `class_id` has one entry per triangle.
struct Surface {
  std::vector<Vec3> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<std::uint16_t> class_id;
  /// lowest and highest coordinates of each file of `meshes`, before the profile raises the mesh
  // NOLINTNEXTLINE(readability-redundant-member-init): GCC warns of initializers without it
  std::vector<std::array<Vec3, 2>> mesh_bounds = {};
};

/// The height that is added to the scene as a function of position, in the world frame. Grades are
/// constant between points, and a parabola rounds each change of grade, as in road design.
class Profile {
 public:
  /// The rise is zero everywhere if the scene has no profile.
  explicit Profile(const SceneConfig& scene);

  bool level() const { return changes_.empty(); }
  double rise(Vec2 place) const;

  /// Raises every vertex by the rise at its position. Triangles are cut until no edge is more than
  /// a centimetre from the true surface. An edge that two triangles share is cut at the same points
  /// in both.
  void lift(Surface& surface) const;
  /// Puts vehicles and cyclists on the slope with the pitch of the slope under their wheels.
  /// Pedestrians stay upright.
  void lift(std::vector<ObjectState>& states) const;

 private:
  /// A change of grade at a station.
  struct Change {
    double s = 0;
    double grade = 0;
  };
  double station(Vec2 place) const;
  double rise_at(double s) const;
  double bent(Vec3 from, Vec3 to) const;
  void cut(Surface& surface) const;
  Box3d on_slope(const Box3d& box) const;

  Vec2 origin_, axis_;
  double curve_m_ = 1;
  double first_m_ = 0;
  std::vector<Change> changes_;
};

}  // namespace infrasim
