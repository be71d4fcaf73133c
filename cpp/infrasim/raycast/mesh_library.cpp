#include <algorithm>
#include <stdexcept>

#include "infrasim/core/math.h"
#include "infrasim/raycast/mesh_scene.h"

namespace infrasim {

namespace {

GeometryHandle mesh_geometry(RTCDevice device, const MeshScene& mesh, const EmbreeError& error) {
  GeometryHandle handle(rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE));
  error.check();
  rtcSetSharedGeometryBuffer(handle.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                             mesh.vertices.data(), 0, 3 * sizeof(float), mesh.vertices.size() - 1);
  error.check();
  rtcSetSharedGeometryBuffer(handle.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                             mesh.triangles.data(), 0, 3 * sizeof(std::uint32_t),
                             mesh.triangles.size());
  error.check();
  rtcCommitGeometry(handle.get());
  error.check();
  return handle;
}

MeshScene mesh_scene(RTCDevice device, const TriangleMesh& mesh, const EmbreeError& error) {
  MeshScene out{mesh.vertices, mesh.triangles, SceneHandle(rtcNewScene(device))};
  out.vertices.emplace_back();  // Embree reads 4 bytes beyond the last vertex
  error.check();
  rtcSetSceneFlags(out.scene.get(), RTC_SCENE_FLAG_ROBUST);
  if (!out.triangles.empty())
    rtcAttachGeometryByID(out.scene.get(), mesh_geometry(device, out, error).get(), 0);
  rtcCommitScene(out.scene.get());
  error.check();
  return out;
}

}  // namespace

MeshLibrary::MeshLibrary(const TriangleMesh& background, std::span<const TriangleMesh> bodies)
    : impl_(std::make_unique<Impl>()) {
  // Embree uses one build thread, so that the hierarchy does not depend on the number of threads.
  // It uses an instruction set that every x86-64 processor has, and ignores the user's
  // configuration files, so that the hits do not depend on the machine.
  impl_->device = rtcNewDevice("threads=1,set_affinity=0,ignore_config_files=1,isa=sse2");
  if (impl_->device == nullptr) throw std::runtime_error("Embree can't create a device");
  impl_->error.watch(impl_->device);
  impl_->background_class = background.class_id;
  for (const TriangleMesh& body : bodies)
    impl_->meshes.push_back(mesh_scene(impl_->device, body, impl_->error));
  impl_->meshes.push_back(mesh_scene(impl_->device, background, impl_->error));
}

MeshLibrary::~MeshLibrary() = default;
MeshLibrary::MeshLibrary(MeshLibrary&&) noexcept = default;

CastOrigin MeshLibrary::origin(Vec3 position, double yaw) const {
  const MeshScene& mesh = impl_->meshes.back();
  const double c = math::cos(yaw), s = math::sin(yaw);
  CastOrigin out{.position = position, .yaw = yaw, .horizon = {}};
  for (const auto& triangle : mesh.triangles) {
    std::array<Vec2, 3> outline;
    double top = -kInf;
    for (std::size_t i = 0; i < 3; ++i) {
      const auto& vertex = mesh.vertices[triangle[i]];
      const Vec2 d = Vec2{vertex[0], vertex[1]} - Vec2{position.x, position.y};
      outline[i] = {c * d.x + s * d.y, c * d.y - s * d.x};
      top = std::max(top, vertex[2] - position.z);
    }
    if (top > 0)
      for (const ViewBounds& view : view_of(outline, top, top)) out.horizon.add(view);
  }
  return out;
}

RTCDeviceTy* MeshLibrary::device() const { return impl_->device; }

}  // namespace infrasim
