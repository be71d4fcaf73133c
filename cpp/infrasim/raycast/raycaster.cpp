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

namespace infrasim {

namespace {

constexpr std::size_t kWidth = 16;  // of a packet; another width changes last digits
constexpr int kGrid = 8;            // visibility rays along each side of a box

[[noreturn]] void on_error(void* /*unused*/, RTCError code, const char* text) {
  throw std::runtime_error("Embree error " + std::to_string(code) + ": " + text);
}

struct SceneRelease {
  void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
};
using SceneHandle = std::unique_ptr<RTCSceneTy, SceneRelease>;

SceneHandle new_scene(RTCDevice device) {
  SceneHandle scene(rtcNewScene(device));
  rtcSetSceneFlags(scene.get(), RTC_SCENE_FLAG_ROBUST);
  return scene;
}

SceneHandle mesh_scene(RTCDevice device, const TriangleMesh& mesh) {
  SceneHandle handle = new_scene(device);
  if (mesh.triangles.empty()) {
    rtcCommitScene(handle.get());
    return handle;
  }
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  void* vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                           3 * sizeof(float), mesh.vertices.size());
  void* triangles = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                            3 * sizeof(std::uint32_t), mesh.triangles.size());
  std::copy_n(mesh.vertices.front().data(), 3 * mesh.vertices.size(),
              static_cast<float*>(vertices));
  std::copy_n(mesh.triangles.front().data(), 3 * mesh.triangles.size(),
              static_cast<std::uint32_t*>(triangles));
  rtcCommitGeometry(geometry);
  rtcAttachGeometryByID(handle.get(), geometry, 0);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(handle.get());
  return handle;
}

RTCQuaternionDecomposition decomposition(const Box3d& box, double heading) {
  RTCQuaternionDecomposition q;
  rtcInitQuaternionDecomposition(&q);
  rtcQuaternionDecompositionSetScale(&q, static_cast<float>(box.dx), static_cast<float>(box.dy),
                                     static_cast<float>(box.dz));
  rtcQuaternionDecompositionSetQuaternion(&q, static_cast<float>(std::cos(heading / 2)), 0, 0,
                                          static_cast<float>(std::sin(heading / 2)));
  rtcQuaternionDecompositionSetTranslation(&q, static_cast<float>(box.x), static_cast<float>(box.y),
                                           static_cast<float>(box.z));
  return q;
}

/// One packet of rays. What Embree leaves as it is (origins, masks, flags) is set once.
struct Packet {
  alignas(64) std::array<int, kWidth> valid{};
  RTCRayHit16 rh{};

  Packet() {
    for (unsigned& mask : rh.ray.mask) mask = 0xFFFFFFFFU;
  }

  /// Rays from the origin; lanes from `count` on are masked off.
  void fill(const RayBatch& rays, const std::uint32_t* order, std::size_t count, float time_scale) {
    for (std::size_t i = 0; i < kWidth; ++i) {
      const std::uint32_t k = order[i < count ? i : 0];
      valid[i] = i < count ? -1 : 0;
      set(i, rays.dx[k], rays.dy[k], rays.dz[k], rays.max_range,
          std::clamp(rays.time[k] * time_scale, 0.0F, 1.0F));
    }
  }

  void set(std::size_t i, float dx, float dy, float dz, float tfar, float time) {
    rh.ray.dir_x[i] = dx;
    rh.ray.dir_y[i] = dy;
    rh.ray.dir_z[i] = dz;
    rh.ray.tfar[i] = tfar;
    rh.ray.time[i] = time;
    rh.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    rh.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }

  void set_origin(float x, float y, float z) {
    for (std::size_t i = 0; i < kWidth; ++i) {
      rh.ray.org_x[i] = x;
      rh.ray.org_y[i] = y;
      rh.ray.org_z[i] = z;
    }
  }

  void intersect(RTCScene scene) { intersect16(valid.data(), scene, rh); }
};

}  // namespace

struct MeshLibrary::Impl {
  RTCDevice device = nullptr;
  float top = -std::numeric_limits<float>::infinity();  ///< highest z of the background
  std::vector<std::uint16_t> background_class;
  std::vector<SceneHandle> bodies;  ///< the background last

  ~Impl() {
    bodies.clear();
    if (device != nullptr) rtcReleaseDevice(device);
  }
};

MeshLibrary::MeshLibrary(const TriangleMesh& background, std::span<const TriangleMesh> bodies)
    : impl_(std::make_unique<Impl>()) {
  // One build thread, so that a hierarchy never depends on the number of threads.
  impl_->device = rtcNewDevice("threads=1,set_affinity=0");
  if (impl_->device == nullptr) throw std::runtime_error("Embree: no device");
  rtcSetDeviceErrorFunction(impl_->device, on_error, nullptr);
  impl_->background_class = background.class_id;
  for (const auto& vertex : background.vertices) impl_->top = std::max(impl_->top, vertex[2]);
  for (const TriangleMesh& body : bodies) impl_->bodies.push_back(mesh_scene(impl_->device, body));
  impl_->bodies.push_back(mesh_scene(impl_->device, background));
}

MeshLibrary::~MeshLibrary() = default;

/// What takes a direction to the unit box of a body, at mid-frame.
struct BodyTransform {
  float cos_heading, sin_heading, inv_dx, inv_dy, inv_dz;
};

struct Raycaster::Impl {
  const MeshLibrary::Impl& library;
  SceneHandle scene;
  std::vector<MovingBody> moving;
  std::vector<BodyTransform> transforms;
  float time_scale = 1;
  float top = 0;
  Packet packet;
  RayBatch probe;  ///< rays of a visibility test
  HitBatch probe_hits;

  explicit Impl(const MeshLibrary::Impl& l) : library(l), scene(new_scene(l.device)) {}

  void attach(RTCScene instanced, unsigned id, const MovingBody* motion) {
    RTCGeometry instance = rtcNewGeometry(library.device, RTC_GEOMETRY_TYPE_INSTANCE);
    rtcSetGeometryInstancedScene(instance, instanced);
    if (motion != nullptr) {
      const double turn = wrap_angle(motion->to.heading - motion->from.heading);
      const auto q0 = decomposition(motion->from, motion->from.heading);
      const auto q1 = decomposition(motion->to, motion->from.heading + turn);
      rtcSetGeometryTimeStepCount(instance, 2);
      rtcSetGeometryTransformQuaternion(instance, 0, &q0);
      rtcSetGeometryTransformQuaternion(instance, 1, &q1);
    }
    rtcCommitGeometry(instance);
    rtcAttachGeometryByID(scene.get(), instance, id);
    rtcReleaseGeometry(instance);
  }

  void unpack(const std::uint32_t* order, std::size_t count, const RayBatch& rays, HitBatch& hits,
              bool incidence) const {
    const RTCHit16& hit = packet.rh.hit;
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint32_t k = order[i];
      if (hit.geomID[i] == RTC_INVALID_GEOMETRY_ID) continue;
      hits.range[k] = packet.rh.ray.tfar[i];
      const std::size_t instance = hit.instID[0][i];
      const bool background = instance == moving.size();
      hits.object[k] = background ? -1 : static_cast<std::int32_t>(instance);
      hits.class_id[k] = background ? library.background_class[hit.primID[i]] : 0;
      if (!incidence) continue;
      hits.cos_incidence[k] = cos_incidence(i, background ? nullptr : &transforms[instance],
                                            rays.dx[k], rays.dy[k], rays.dz[k]);
    }
  }

  /// Embree's normal stands in the body's unit box and is not of unit length.
  float cos_incidence(std::size_t i, const BodyTransform* body, float dx, float dy,
                      float dz) const {
    const RTCHit16& hit = packet.rh.hit;
    float nx = hit.Ng_x[i], ny = hit.Ng_y[i], nz = hit.Ng_z[i];
    if (body != nullptr) {
      nx *= body->inv_dx;
      ny *= body->inv_dy;
      nz *= body->inv_dz;
      const float x = body->cos_heading * dx + body->sin_heading * dy;
      dy = -body->sin_heading * dx + body->cos_heading * dy;
      dx = x;
    }
    const float length = std::sqrt(nx * nx + ny * ny + nz * nz);
    return length > 0 ? std::min(1.0F, std::abs(nx * dx + ny * dy + nz * dz) / length) : 0.0F;
  }

  /// Which of the probe's rays hit the body with nothing else around, at mid-frame.
  std::vector<bool> hits_alone(const MovingBody& body, const Box3d& box) {
    const RTCScene alone = library.bodies[body.body].get();
    const double c = std::cos(box.heading), s = std::sin(box.heading);
    const auto to_unit = [&](double x, double y, double z) {
      return std::array{static_cast<float>((c * x + s * y) / box.dx),
                        static_cast<float>((-s * x + c * y) / box.dy),
                        static_cast<float>(z / box.dz)};
    };
    const auto o = to_unit(-box.x, -box.y, -box.z);
    std::vector<bool> out(probe.size());
    packet.set_origin(o[0], o[1], o[2]);
    for (std::size_t first = 0; first < probe.size(); first += kWidth) {
      for (std::size_t i = 0; i < kWidth; ++i) {
        const auto d = to_unit(probe.dx[first + i], probe.dy[first + i], probe.dz[first + i]);
        packet.valid[i] = -1;
        packet.set(i, d[0], d[1], d[2], probe.max_range, 0);
      }
      packet.intersect(alone);
      for (std::size_t i = 0; i < kWidth; ++i)
        out[first + i] = packet.rh.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID;
    }
    packet.set_origin(0, 0, 0);
    return out;
  }

  /// Rays at the cell centres of the box's angular rectangle.
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

Raycaster::Raycaster(const MeshLibrary& library) : impl_(std::make_unique<Impl>(*library.impl_)) {}

Raycaster::~Raycaster() = default;

void Raycaster::set_bodies(std::span<const MovingBody> bodies, double period_s) {
  Impl& m = *impl_;
  m.moving.assign(bodies.begin(), bodies.end());
  m.time_scale = static_cast<float>(1 / period_s);
  m.transforms.clear();
  m.top = m.library.top;
  m.scene = new_scene(m.library.device);
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    const MovingBody& b = bodies[i];
    m.attach(m.library.bodies[b.body].get(), static_cast<unsigned>(i), &b);
    m.top = std::max(m.top, static_cast<float>(std::max(b.from.z, b.to.z) + b.from.dz / 2));
    const double heading = b.from.heading + wrap_angle(b.to.heading - b.from.heading) / 2;
    m.transforms.push_back({static_cast<float>(std::cos(heading)),
                            static_cast<float>(std::sin(heading)),
                            static_cast<float>(1 / b.from.dx), static_cast<float>(1 / b.from.dy),
                            static_cast<float>(1 / b.from.dz)});
  }
  m.attach(m.library.bodies.back().get(), static_cast<unsigned>(bodies.size()), nullptr);
  rtcCommitScene(m.scene.get());
}

float Raycaster::top() const { return impl_->top; }

void Raycaster::cast(const RayBatch& rays, std::span<const std::uint32_t> order, HitBatch& hits,
                     bool incidence) {
  // Embree's manual asks for flushed denormals in every thread that casts.
  _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
  _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
  Impl& m = *impl_;
  hits.resize(rays.size());
  std::ranges::fill(hits.range, std::numeric_limits<float>::infinity());
  std::ranges::fill(hits.object, -1);
  for (std::size_t first = 0; first < order.size(); first += kWidth) {
    const std::size_t count = std::min(kWidth, order.size() - first);
    m.packet.fill(rays, order.data() + first, count, m.time_scale);
    m.packet.intersect(m.scene.get());
    m.unpack(order.data() + first, count, rays, hits, incidence);
  }
}

double Raycaster::visibility(std::size_t index) {
  static constexpr auto kOrder = [] {
    std::array<std::uint32_t, static_cast<std::size_t>(kGrid * kGrid)> order{};
    std::iota(order.begin(), order.end(), 0U);
    return order;
  }();
  Impl& m = *impl_;
  const MovingBody& body = m.moving[index];
  Box3d box = body.from;
  box.x = (body.from.x + body.to.x) / 2;
  box.y = (body.from.y + body.to.y) / 2;
  box.z = (body.from.z + body.to.z) / 2;
  box.heading += wrap_angle(body.to.heading - body.from.heading) / 2;
  m.aim_probe(box);
  const std::vector<bool> alone = m.hits_alone(body, box);
  cast(m.probe, kOrder, m.probe_hits, false);
  int could = 0, reached = 0;
  for (std::size_t i = 0; i < alone.size(); ++i) {
    if (!alone[i]) continue;
    ++could;
    reached += m.probe_hits.object[i] == static_cast<std::int32_t>(index);
  }
  return could == 0 ? 0 : static_cast<double>(reached) / could;
}

}  // namespace infrasim
