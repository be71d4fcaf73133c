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

/// Volumes of leaves, for rays from the origin of the levelled frame. A volume stops a ray with a
/// probability per metre (Beer-Lambert). The random sample of the ray determines the range at which
/// the volume stops it.
class Volumes {
 public:
  Volumes() = default;
  /// @param volumes volumes in the levelled frame
  explicit Volumes(std::span<const LeafVolume> volumes);

  bool empty() const { return volumes_.empty(); }
  /// Returns the index of volumes by the directions that they cover.
  const BodyIndex& index() const { return index_; }
  const Horizon& horizon() const { return horizon_; }

  /// Part of a ray within a volume, as ranges in metres; empty unless from < to.
  struct Way {
    double from = 0, to = 0;
  };
  /// The part of one ray of a batch within one volume.
  struct RayWay {
    std::uint32_t ray;
    std::uint32_t volume;
    Way way;
    double passes;  ///< a ray with a smaller random sample certainly passes the volume
  };

  /// Calls use(RayWay) for each volume that each ray meets before its hit.
  /// @param order rays that may meet a volume; neighbouring rays should be together
  template <class Use>
  void for_each_way(const RayBatch& rays, std::span<const std::uint32_t> order,
                    std::span<const float> hit_range, const Use& use) const {
    for_each_packet(order, [&](std::span<const std::uint32_t> packet) {
      float farthest = 0;
      for (const std::uint32_t k : packet) farthest = std::max(farthest, hit_range[k]);
      index_.for_each_in(view_of(rays, packet), [&](std::size_t v) {
        if (volumes_[v].nearest_m > farthest) return true;
        for (const std::uint32_t k : packet) {
          const Way way = way_through(v, rays.dx[k], rays.dy[k], rays.dz[k]);
          if (way.from < way.to && way.from < std::min<double>(hit_range[k], rays.max_range))
            use(RayWay{k, static_cast<std::uint32_t>(v), way, 0});
        }
        return true;
      });
    });
  }

  /// Returns the way with `passes` computed. This saves time if a way is used several times.
  RayWay with_limit(RayWay way) const;

  /// Replaces the hit of a ray if leaves stop the ray before the hit.
  /// @param rng random stream of the ray
  void stop_in(const RayWay& way, const Rng& rng, std::uint32_t ray, float max_range,
               HitBatch& hits) const;

  /// Replaces the hit of each ray that leaves stop before the hit. The result depends neither on
  /// the order of the rays nor on rays that meet no volume.
  /// @param order    rays that may meet a volume; neighbouring rays should be together
  /// @param rng_of returns the random stream of a ray by its index
  template <class RngOf>
  void stop(const RayBatch& rays, std::span<const std::uint32_t> order, const RngOf& rng_of,
            HitBatch& hits) const {
    for_each_way(rays, order, hits.range, [&](const RayWay& way) {
      stop_in(way, rng_of(way.ray), way.ray, rays.max_range, hits);
    });
  }

  /// Returns the share of rays in a direction that no leaf stops before a range.
  double transmission(float dx, float dy, float dz, double range) const;

 private:
  /// Transforms rays to the unit sphere, or to the cube around it.
  struct Volume {
    bool ellipsoid;
    double density_per_m;
    double cos, sin;
    double inv_x, inv_y, inv_z;  ///< inverse of half the volume's size along each axis
    double x, y, z;              ///< origin of the rays in the frame of the unit sphere
    double nearest_m;            ///< lower limit of the range of any part of the volume, in metres
  };
  Way way_through(std::size_t volume, float dx, float dy, float dz) const;

  std::vector<Volume> volumes_;
  BodyIndex index_;
  Horizon horizon_;
};

}  // namespace infrasim
