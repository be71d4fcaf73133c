#include "infrasim/raycast/raycaster.h"

#include <pmmintrin.h>
#include <xmmintrin.h>

#include <algorithm>
#include <array>
#include <bit>
#include <iterator>
#include <numeric>
#include <vector>

#include "infrasim/core/math.h"
#include "infrasim/raycast/mesh_scene.h"

namespace infrasim {

namespace {

constexpr int kGrid = 8;  // number of visibility rays along each side of the grid over a box

/// Returns whether a ray meets the unit box, in which the mesh of a body lies, between two ranges.
/// Also returns true for some rays that pass slightly beside the box.
/// @param margin length by which the box is enlarged on each side, along x, y and z
bool meets_unit_box(const BodyMotion::UnitRay& ray, float from, float to,
                    const std::array<float, 3>& margin = {}) {
  // half the side of the unit box, with a margin larger than rounding errors
  constexpr float kHalf = 0.5F + 1e-3F;
  const auto clip = [&](float origin, float direction, float beside) {
    const float inverse = 1 / direction, half = kHalf + beside;
    const float a = (-half - origin) * inverse, b = (half - origin) * inverse;
    // A ray in the plane of a side gives NaN, which does not change the limits.
    from = std::max(from, std::min(a, b));
    to = std::min(to, std::max(a, b));
  };
  clip(ray.x, ray.dx, margin[0]);
  clip(ray.y, ray.dy, margin[1]);
  clip(ray.z, ray.dz, margin[2]);
  return from <= to * (1 + 1e-5F);
}

/// Replaces denormal numbers by zero, as Embree's manual recommends for threads that cast. The
/// destructor restores the caller's mode.
class FlushedDenormals {
 public:
  FlushedDenormals() : before_(_mm_getcsr()) {
    _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
    _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
  }
  ~FlushedDenormals() { _mm_setcsr(before_); }
  FlushedDenormals(const FlushedDenormals&) = delete;
  FlushedDenormals& operator=(const FlushedDenormals&) = delete;

 private:
  unsigned before_;
};

void clear(std::size_t n, HitBatch& hits) {
  hits.resize(n);
  std::ranges::fill(hits.range, std::numeric_limits<float>::infinity());
  std::ranges::fill(hits.object, -1);
  std::ranges::fill(hits.class_id, std::uint16_t{0});
}

}  // namespace

struct Raycaster::Impl {
  const MeshLibrary::Impl& library;
  CastOrigin origin;
  float cos, sin;  ///< cosine and sine of the origin's yaw
  std::vector<MovingBody> moving;
  std::vector<BodyMotion> motions;
  std::vector<float> farthest_m;  ///< longest range of any part of each body during the frame
  BodyIndex index;
  float time_scale = 1;
  Horizon horizon;
  Packet packet;
  /// numbers of the rays to cast at one body
  std::array<std::uint32_t, kPacketRays> queued{};
  std::array<BodyMotion::UnitRay, kPacketRays> queued_unit{};
  std::size_t queue_size = 0;
  /// for each body, the packets that may meet it
  std::vector<std::vector<std::uint32_t>> packets_of;
  RayBatch probe;  ///< rays of a visibility test
  HitBatch probe_hits;

  Impl(const MeshLibrary::Impl& l, const CastOrigin& from)
      : library(l),
        origin(from),
        cos(static_cast<float>(math::cos(from.yaw))),
        sin(static_cast<float>(math::sin(from.yaw))) {}

  const MeshScene& background() const { return library.meshes.back(); }

  /// Returns a ray in the frame of the mesh library.
  BodyMotion::UnitRay in_library(const RayBatch& rays, std::uint32_t k) const {
    const auto [x, y, z] = origin.position;
    return {static_cast<float>(x),
            static_cast<float>(y),
            static_cast<float>(z),
            cos * rays.dx[k] - sin * rays.dy[k],
            sin * rays.dx[k] + cos * rays.dy[k],
            rays.dz[k]};
  }

  /// Queues the rays of a packet that meet the box of a body.
  void queue(std::size_t body, const RayBatch& rays, std::span<const std::uint32_t> order,
             HitBatch& hits, bool incidence) {
    const BodyMotion& motion = motions[body];
    for (const std::uint32_t k : order) {
      const float share = std::clamp(rays.time[k] * time_scale, 0.0F, 1.0F);
      const BodyMotion::UnitRay unit = motion.to_unit(rays.dx[k], rays.dy[k], rays.dz[k], share);
      if (!meets_unit_box(unit, rays.near_range(k), std::min(hits.range[k], rays.max_range)))
        continue;
      queued[queue_size] = k;
      queued_unit[queue_size] = unit;
      if (++queue_size == kPacketRays) cast_queue(body, rays, hits, incidence);
    }
  }

  /// Casts the queued rays at a body. A hit replaces the previous hit of its ray if it is nearer.
  void cast_queue(std::size_t body, const RayBatch& rays, HitBatch& hits, bool incidence) {
    if (queue_size == 0) return;
    const BodyMotion& motion = motions[body];
    const MeshScene& mesh = library.meshes[static_cast<std::size_t>(moving[body].body)];
    for (std::size_t i = 0; i < queue_size; ++i) {
      const std::uint32_t k = queued[i];
      packet.set(i, queued_unit[i], rays.near_range(k), std::min(hits.range[k], rays.max_range));
    }
    packet.intersect(mesh.scene.get(), queue_size);
    const RTCHit16& hit = packet.rh.hit;
    for (std::size_t i = 0; i < queue_size; ++i) {
      if (!packet.hit(i)) continue;
      const std::uint32_t k = queued[i];
      const BodyMotion::UnitRay& unit = queued_unit[i];
      const float range = packet.plane_hit(i, mesh, unit).range;
      if (!(range < hits.range[k])) continue;
      hits.range[k] = range;
      hits.object[k] = static_cast<std::int32_t>(body);
      if (!incidence) continue;
      hits.cos_incidence[k] = motion.cos_incidence(unit, hit.Ng_x[i], hit.Ng_y[i], hit.Ng_z[i]);
      hits.place[k] = {unit.at(range), motion.normal(hit.Ng_x[i], hit.Ng_y[i], hit.Ng_z[i])};
    }
    queue_size = 0;
  }

  /// Makes rays through the centres of the cells of a grid. The grid covers the rectangle of
  /// azimuth and elevation that contains the box.
  void aim_probe(const Box3d& box) {
    const double centre = math::atan2(box.y, box.x);
    double left = -kPi, right = kPi, up = -kPi, down = kPi;
    const auto corners = footprint(box);
    for (const Vec2& corner : corners)
      for (const double z : {box.z - box.dz / 2, box.z + box.dz / 2}) {
        const double azimuth = wrap_angle(math::atan2(corner.y, corner.x) - centre);
        const double elevation = math::atan2(z, norm(corner));
        left = std::max(left, azimuth);
        right = std::min(right, azimuth);
        up = std::max(up, elevation);
        down = std::min(down, elevation);
      }
    probe.resize(kGrid * kGrid);
    probe.max_range = 1e6F;
    for (int i = 0; i < kGrid; ++i)
      for (int j = 0; j < kGrid; ++j) {
        const double azimuth = centre + right + (left - right) * (i + 0.5) / kGrid;
        const double elevation = down + (up - down) * (j + 0.5) / kGrid;
        const auto k = static_cast<std::size_t>(i) * kGrid + static_cast<std::size_t>(j);
        probe.dx[k] = static_cast<float>(math::cos(elevation) * math::cos(azimuth));
        probe.dy[k] = static_cast<float>(math::cos(elevation) * math::sin(azimuth));
        probe.dz[k] = static_cast<float>(math::sin(elevation));
        probe.time[k] = 0.5F / time_scale;
      }
  }
};

Raycaster::Raycaster(const MeshLibrary& library, const CastOrigin& origin)
    : impl_(std::make_unique<Impl>(*library.impl_, origin)) {
  set_bodies({}, 1);
}

Raycaster::~Raycaster() = default;

void Raycaster::set_bodies(std::span<const MovingBody> bodies, double period_s) {
  Impl& m = *impl_;
  m.moving.assign(bodies.begin(), bodies.end());
  m.motions.clear();
  m.farthest_m.clear();
  m.index.set(bodies);
  m.time_scale = static_cast<float>(1 / period_s);
  m.horizon = m.origin.horizon;
  for (const MovingBody& b : bodies) {
    m.motions.emplace_back(b);
    double farthest = 0;
    for (const Box3d& box : {b.from, b.to})
      farthest = std::max(farthest,
                          norm(Vec3{box.x, box.y, box.z}) + norm(Vec3{box.dx, box.dy, box.dz}) / 2);
    m.farthest_m.push_back(static_cast<float>(farthest));
  }
  for (const auto& views : m.index.views())
    for (const ViewBounds& view : views) m.horizon.add(view);
}

const Horizon& Raycaster::horizon() const { return impl_->horizon; }

const BodyIndex& Raycaster::bodies() const { return impl_->index; }

void Raycaster::cast(const RayBatch& rays, std::span<const std::uint32_t> order, HitBatch& hits,
                     bool incidence) {
  cast_background(rays, order, hits, incidence);
  cast_bodies(rays, order, hits, incidence);
}

void Raycaster::cast_background(const RayBatch& rays, std::span<const std::uint32_t> order,
                                HitBatch& hits, bool incidence) {
  const FlushedDenormals flushed;
  Impl& m = *impl_;
  clear(rays.size(), hits);
  std::array<BodyMotion::UnitRay, kPacketRays> in_library;
  for_each_packet(order, [&](std::span<const std::uint32_t> part) {
    for (std::size_t i = 0; i < part.size(); ++i) {
      in_library[i] = m.in_library(rays, part[i]);
      m.packet.set(i, in_library[i], rays.near_range(part[i]), rays.max_range);
    }
    m.packet.intersect(m.background().scene.get(), part.size());
    const RTCHit16& hit = m.packet.rh.hit;
    for (std::size_t i = 0; i < part.size(); ++i) {
      if (!m.packet.hit(i)) continue;
      const std::uint32_t k = part[i];
      const PlaneHit plane = m.packet.plane_hit(i, m.background(), in_library[i]);
      hits.range[k] = plane.range;
      hits.class_id[k] = m.library.background_class[hit.primID[i]];
      if (!incidence) continue;
      const double length = norm(Vec3{hit.Ng_x[i], hit.Ng_y[i], hit.Ng_z[i]});
      hits.cos_incidence[k] =
          length > 0 ? static_cast<float>(std::min(1.0, std::abs(plane.ahead) / length)) : 0.0F;
    }
  });
  m.library.error.check();
}

void Raycaster::near_bodies(const RayBatch& rays, std::span<const std::uint32_t> order,
                            std::span<const float> range, float spread, float from_m,
                            std::vector<std::uint32_t>& near) const {
  const Impl& m = *impl_;
  near.clear();
  for_each_packet(order, [&](std::span<const std::uint32_t> part) {
    ViewBounds view;
    for (const std::uint32_t k : part) view.add_cone(rays.dx[k], rays.dy[k], rays.dz[k], spread);
    std::uint32_t meets = 0;  // one bit per ray of the packet, set if its cone may meet a body
    m.index.for_each_in(view, [&](std::size_t body) {
      if (m.farthest_m[body] < from_m) return true;
      const BodyMotion& motion = m.motions[body];
      const std::array<float, 3> margin = motion.to_unit_lengths(spread * m.farthest_m[body]);
      for (std::size_t i = 0; i < part.size(); ++i) {
        const std::uint32_t k = part[i];
        const float share = std::clamp(rays.time[k] * m.time_scale, 0.0F, 1.0F);
        if (meets_unit_box(motion.to_unit(rays.dx[k], rays.dy[k], rays.dz[k], share), 0,
                           std::min(range[k], rays.max_range), margin))
          meets |= 1U << i;
      }
      return true;
    });
    for (; meets != 0; meets &= meets - 1)
      near.push_back(part[static_cast<std::size_t>(std::countr_zero(meets))]);
  });
}

void Raycaster::cast_bodies(const RayBatch& rays, std::span<const std::uint32_t> order,
                            HitBatch& hits, bool incidence) {
  const FlushedDenormals flushed;
  Impl& m = *impl_;
  m.packets_of.resize(m.moving.size());
  for (auto& packets : m.packets_of) packets.clear();
  std::uint32_t number = 0;
  for_each_packet(order, [&](std::span<const std::uint32_t> part) {
    m.index.for_each_in(view_of(rays, part), [&](std::size_t body) {
      m.packets_of[body].push_back(number);
      return true;
    });
    ++number;
  });
  for (std::size_t body = 0; body < m.moving.size(); ++body) {
    for (const std::uint32_t p : m.packets_of[body])
      m.queue(body, rays, packet_of(order, p), hits, incidence);
    m.cast_queue(body, rays, hits, incidence);
  }
  m.library.error.check();
}

double Raycaster::visibility(std::size_t index, const Volumes& leaves) {
  static constexpr auto kOrder = [] {
    std::array<std::uint32_t, static_cast<std::size_t>(kGrid * kGrid)> order{};
    std::iota(order.begin(), order.end(), 0U);
    return order;
  }();
  Impl& m = *impl_;
  m.aim_probe(levelled(box_at(m.moving[index], 0.5)));
  clear(m.probe.size(), m.probe_hits);
  m.queue(index, m.probe, kOrder, m.probe_hits, false);
  m.cast_queue(index, m.probe, m.probe_hits, false);
  const auto own = static_cast<std::int32_t>(index);
  std::vector<std::uint32_t> meeting;  // rays that hit the body if it is the only object
  std::ranges::copy_if(kOrder, std::back_inserter(meeting),
                       [&](std::uint32_t k) { return m.probe_hits.object[k] == own; });
  cast(m.probe, meeting, m.probe_hits, false);
  double first = 0;
  for (const std::uint32_t k : meeting)
    if (m.probe_hits.object[k] == own)
      first +=
          leaves.transmission(m.probe.dx[k], m.probe.dy[k], m.probe.dz[k], m.probe_hits.range[k]);
  return meeting.empty() ? 0 : first / static_cast<double>(meeting.size());
}

}  // namespace infrasim
