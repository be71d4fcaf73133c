#include "infrasim/raycast/raycaster.h"

#include <pmmintrin.h>
#include <xmmintrin.h>

#include <algorithm>
#include <array>
#include <numeric>
#include <stdexcept>
#include <string>
#include <vector>

#include "infrasim/raycast/embree.h"
#include "infrasim/raycast/packets.h"

namespace infrasim {

namespace {

constexpr int kGrid = 8;  // visibility rays along each side of a box

struct Release {
  void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
  void operator()(RTCGeometry geometry) const { rtcReleaseGeometry(geometry); }
};
using SceneHandle = std::unique_ptr<RTCSceneTy, Release>;
using GeometryHandle = std::unique_ptr<RTCGeometryTy, Release>;

GeometryHandle mesh_geometry(RTCDevice device, const TriangleMesh& mesh, const EmbreeError& error) {
  GeometryHandle handle(rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE));
  error.check();
  void* vertices =
      rtcSetNewGeometryBuffer(handle.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                              3 * sizeof(float), mesh.vertices.size());
  error.check();
  void* triangles =
      rtcSetNewGeometryBuffer(handle.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                              3 * sizeof(std::uint32_t), mesh.triangles.size());
  error.check();
  std::copy_n(mesh.vertices.front().data(), 3 * mesh.vertices.size(),
              static_cast<float*>(vertices));
  std::copy_n(mesh.triangles.front().data(), 3 * mesh.triangles.size(),
              static_cast<std::uint32_t*>(triangles));
  rtcCommitGeometry(handle.get());
  return handle;
}

SceneHandle mesh_scene(RTCDevice device, const TriangleMesh& mesh, const EmbreeError& error) {
  SceneHandle handle(rtcNewScene(device));
  error.check();
  rtcSetSceneFlags(handle.get(), RTC_SCENE_FLAG_ROBUST);
  if (!mesh.triangles.empty())
    rtcAttachGeometryByID(handle.get(), mesh_geometry(device, mesh, error).get(), 0);
  rtcCommitScene(handle.get());
  error.check();
  return handle;
}

/// One packet of rays. Fields that Embree does not change (masks, flags, nearest range) are set
/// only once.
struct Packet {
  alignas(64) std::array<int, kPacketRays> valid{};
  RTCRayHit16 rh{};

  Packet() {
    for (unsigned& mask : rh.ray.mask) mask = 0xFFFFFFFFU;
  }

  void set(std::size_t i, const BodyMotion::UnitRay& ray, float tnear, float tfar) {
    rh.ray.org_x[i] = ray.x;
    rh.ray.org_y[i] = ray.y;
    rh.ray.org_z[i] = ray.z;
    rh.ray.dir_x[i] = ray.dx;
    rh.ray.dir_y[i] = ray.dy;
    rh.ray.dir_z[i] = ray.dz;
    rh.ray.tnear[i] = tnear;
    rh.ray.tfar[i] = tfar;
    rh.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
  }

  /// Casts the first `count` rays of the packet.
  void intersect(RTCScene scene, std::size_t count) {
    for (std::size_t i = 0; i < kPacketRays; ++i) valid[i] = i < count ? -1 : 0;
    intersect16(valid.data(), scene, rh);
  }

  bool hit(std::size_t i) const { return rh.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID; }
};

/// Flushes denormals, as Embree's manual recommends for threads that cast. The destructor restores
/// the caller's mode.
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

Horizon horizon_of(const TriangleMesh& mesh) {
  Horizon horizon;
  for (const auto& triangle : mesh.triangles) {
    std::array<Vec2, 3> outline;
    double top = -kInf;
    for (std::size_t i = 0; i < 3; ++i) {
      const auto& vertex = mesh.vertices[triangle[i]];
      outline[i] = {vertex[0], vertex[1]};
      top = std::max<double>(top, vertex[2]);
    }
    if (top > 0)
      for (const ViewBounds& view : view_of(outline, top, top)) horizon.add(view);
  }
  return horizon;
}

float cos_incidence(const RayBatch& rays, std::uint32_t k, float nx, float ny, float nz) {
  const float length = std::sqrt(nx * nx + ny * ny + nz * nz);
  const float ahead = std::abs(nx * rays.dx[k] + ny * rays.dy[k] + nz * rays.dz[k]);
  return length > 0 ? std::min(1.0F, ahead / length) : 0.0F;
}

}  // namespace

struct MeshLibrary::Impl {
  EmbreeError error;
  RTCDevice device = nullptr;
  Horizon horizon;  ///< horizon of the background
  std::vector<std::uint16_t> background_class;
  std::vector<SceneHandle> bodies;  ///< one per body, then the background

  ~Impl() {
    bodies.clear();
    if (device != nullptr) rtcReleaseDevice(device);
  }
};

MeshLibrary::MeshLibrary(const TriangleMesh& background, std::span<const TriangleMesh> bodies)
    : impl_(std::make_unique<Impl>()) {
  // One build thread, so that the hierarchy does not depend on the number of threads.
  impl_->device = rtcNewDevice("threads=1,set_affinity=0");
  if (impl_->device == nullptr) throw std::runtime_error("Embree: no device");
  impl_->error.watch(impl_->device);
  impl_->background_class = background.class_id;
  impl_->horizon = horizon_of(background);
  for (const TriangleMesh& body : bodies)
    impl_->bodies.push_back(mesh_scene(impl_->device, body, impl_->error));
  impl_->bodies.push_back(mesh_scene(impl_->device, background, impl_->error));
}

MeshLibrary::~MeshLibrary() = default;

struct Raycaster::Impl {
  const MeshLibrary::Impl& library;
  std::vector<MovingBody> moving;
  std::vector<BodyMotion> motions;
  BodyIndex index;
  float time_scale = 1;
  Horizon horizon;
  Packet packet;
  RayBatch probe;  ///< rays of a visibility test
  HitBatch probe_hits;

  explicit Impl(const MeshLibrary::Impl& l) : library(l) {}

  RTCScene background() const { return library.bodies.back().get(); }

  /// Casts one packet at one body and keeps hits that are nearer than the previous ones.
  void cast_body(std::size_t body, const RayBatch& rays, std::span<const std::uint32_t> order,
                 HitBatch& hits, bool incidence) {
    const BodyMotion& motion = motions[body];
    std::array<BodyMotion::UnitRay, kPacketRays> unit;
    for (std::size_t i = 0; i < order.size(); ++i) {
      const std::uint32_t k = order[i];
      const float share = std::clamp(rays.time[k] * time_scale, 0.0F, 1.0F);
      unit[i] = motion.to_unit(rays.dx[k], rays.dy[k], rays.dz[k], share);
      packet.set(i, unit[i], rays.near_range(k), std::min(hits.range[k], rays.max_range));
    }
    packet.intersect(library.bodies[moving[body].body].get(), order.size());
    const RTCHit16& hit = packet.rh.hit;
    for (std::size_t i = 0; i < order.size(); ++i) {
      const std::uint32_t k = order[i];
      if (!packet.hit(i) || !(packet.rh.ray.tfar[i] < hits.range[k])) continue;
      hits.range[k] = packet.rh.ray.tfar[i];
      hits.object[k] = static_cast<std::int32_t>(body);
      if (!incidence) continue;
      hits.cos_incidence[k] = motion.cos_incidence(unit[i], hit.Ng_x[i], hit.Ng_y[i], hit.Ng_z[i]);
      hits.place[k] = {unit[i].at(hits.range[k]),
                       motion.normal(hit.Ng_x[i], hit.Ng_y[i], hit.Ng_z[i])};
    }
  }

  /// Makes rays through the centres of the grid cells in the box's angular rectangle.
  void aim_probe(const Box3d& box) {
    const double centre = std::atan2(box.y, box.x);
    double left = -kPi, right = kPi, up = -kPi, down = kPi;
    const auto corners = footprint(box);
    for (const Vec2& corner : corners)
      for (const double z : {box.z - box.dz / 2, box.z + box.dz / 2}) {
        const double azimuth = wrap_angle(std::atan2(corner.y, corner.x) - centre);
        const double elevation = std::atan2(z, norm(corner));
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
        probe.dx[k] = static_cast<float>(std::cos(elevation) * std::cos(azimuth));
        probe.dy[k] = static_cast<float>(std::cos(elevation) * std::sin(azimuth));
        probe.dz[k] = static_cast<float>(std::sin(elevation));
        probe.time[k] = 0.5F / time_scale;
      }
  }
};

Raycaster::Raycaster(const MeshLibrary& library) : impl_(std::make_unique<Impl>(*library.impl_)) {
  set_bodies({}, 1);
}

Raycaster::~Raycaster() = default;

void Raycaster::set_bodies(std::span<const MovingBody> bodies, double period_s) {
  Impl& m = *impl_;
  m.moving.assign(bodies.begin(), bodies.end());
  m.motions.clear();
  m.index.set(bodies);
  m.time_scale = static_cast<float>(1 / period_s);
  m.horizon = m.library.horizon;
  for (const MovingBody& b : bodies) m.motions.emplace_back(b);
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
  for_each_packet(order, [&](std::span<const std::uint32_t> part) {
    for (std::size_t i = 0; i < part.size(); ++i) {
      const std::uint32_t k = part[i];
      m.packet.set(i, {0, 0, 0, rays.dx[k], rays.dy[k], rays.dz[k]}, rays.near_range(k),
                   rays.max_range);
    }
    m.packet.intersect(m.background(), part.size());
    const RTCHit16& hit = m.packet.rh.hit;
    for (std::size_t i = 0; i < part.size(); ++i) {
      if (!m.packet.hit(i)) continue;
      const std::uint32_t k = part[i];
      hits.range[k] = m.packet.rh.ray.tfar[i];
      hits.class_id[k] = m.library.background_class[hit.primID[i]];
      if (incidence)
        hits.cos_incidence[k] = cos_incidence(rays, k, hit.Ng_x[i], hit.Ng_y[i], hit.Ng_z[i]);
    }
  });
}

void Raycaster::cast_bodies(const RayBatch& rays, std::span<const std::uint32_t> order,
                            HitBatch& hits, bool incidence) {
  const FlushedDenormals flushed;
  Impl& m = *impl_;
  for_each_packet(order, [&](std::span<const std::uint32_t> part) {
    m.index.for_each_in(view_of(rays, part), [&](std::size_t body) {
      m.cast_body(body, rays, part, hits, incidence);
      return true;
    });
  });
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
  for_each_packet(kOrder, [&](std::span<const std::uint32_t> part) {
    m.cast_body(index, m.probe, part, m.probe_hits, false);
  });
  const auto alone = std::ranges::count(m.probe_hits.object, static_cast<std::int32_t>(index));
  cast(m.probe, kOrder, m.probe_hits, false);
  double first = 0;
  for (const std::uint32_t k : kOrder)
    if (m.probe_hits.object[k] == static_cast<std::int32_t>(index))
      first +=
          leaves.transmission(m.probe.dx[k], m.probe.dy[k], m.probe.dz[k], m.probe_hits.range[k]);
  return alone == 0 ? 0 : first / static_cast<double>(alone);
}

}  // namespace infrasim
