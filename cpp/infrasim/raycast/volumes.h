#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "infrasim/core/rays.h"
#include "infrasim/core/rng.h"
#include "infrasim/raycast/moving_bodies.h"
#include "infrasim/raycast/packets.h"
#include "infrasim/scene/vegetation.h"

namespace infrasim {

/// Volumes of leaves, as rays from the origin of the levelled frame meet them. In each a ray is
/// stopped with a chance per metre (Beer-Lambert), where a draw of its own says.
class Volumes {
 public:
  Volumes() = default;
  /// @param volumes levelled frame
  explicit Volumes(std::span<const LeafVolume> volumes);

  bool empty() const { return volumes_.empty(); }
  /// Where volumes are seen.
  const BodyIndex& index() const { return index_; }
  const Horizon& horizon() const { return horizon_; }

  /// Replaces the hits of rays that leaves stop before. Neither the order of the rays nor rays that
  /// meet no volume change anything.
  /// @param order    rays that may meet a volume, near ones together
  /// @param draws_of random numbers of a ray, by its index: of its leaf, and of each volume
  template <class DrawsOf>
  void stop(const RayBatch& rays, std::span<const std::uint32_t> order, const DrawsOf& draws_of,
            HitBatch& hits) const {
    for_each_packet(order, [&](std::span<const std::uint32_t> packet) {
      index_.for_each_in(view_of(rays, packet), [&](std::size_t v) {
        for (const std::uint32_t k : packet) {
          const Way way = way_through(v, rays.dx[k], rays.dy[k], rays.dz[k]);
          if (way.from < way.to && way.from < std::min<double>(hits.range[k], rays.max_range))
            stop_in(v, way, draws_of(k), k, rays.max_range, hits);
        }
        return true;
      });
    });
  }

  /// Share of rays along a direction that no leaf stops before a range.
  double transmission(float dx, float dy, float dz, double range) const;

 private:
  /// Takes rays to the unit sphere, or to the cube around it.
  struct Volume {
    bool ellipsoid;
    double density_per_m;
    double cos, sin;
    double inv_x, inv_y, inv_z;  ///< of half its size
    double x, y, z;              ///< the rays' origin
  };
  /// Part of a ray within a volume, metres; none unless from < to.
  struct Way {
    double from = 0, to = 0;
  };

  Way way_through(std::size_t volume, float dx, float dy, float dz) const;
  void stop_in(std::size_t volume, const Way& way, const Rng& draws, std::uint32_t ray,
               float max_range, HitBatch& hits) const;

  std::vector<Volume> volumes_;
  BodyIndex index_;
  Horizon horizon_;
};

}  // namespace infrasim
