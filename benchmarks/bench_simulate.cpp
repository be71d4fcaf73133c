// Measures the rays per second of the simulator and of a bare loop over Embree, and how the rate
// depends on triangles and vehicles; see docs/results/speed.md.

#include <benchmark/benchmark.h>
#include <malloc.h>

#include <algorithm>
#include <array>
#include <map>
#include <mutex>

#include "infrasim/io/kitti.h"
#include "infrasim/pipeline/simulate.h"
#include "infrasim/raycast/embree.h"
#include "infrasim/sensor/scan_pattern.h"

namespace {

using namespace infrasim;

constexpr int kFrames = 20;  // several frames, because the rate differs between frames

std::string configs(const std::string& name) { return std::string(INFRASIM_CONFIGS) + "/" + name; }

/// Returns the world of the highway with these overrides. Each world is built once.
/// @param preset preset of the scene, which has plants with `datasheet`
const World& world(const std::vector<std::string>& assignments, const std::string& preset = "") {
  static std::mutex mutex;
  static std::map<std::pair<std::vector<std::string>, std::string>, World> worlds;
  const std::lock_guard lock(mutex);
  const std::pair key{assignments, preset};
  const auto it = worlds.find(key);
  if (it != worlds.end()) return it->second;
  return worlds
      .emplace(key, build_world(read_scene(configs("scenes/highway.yaml"), assignments, preset)))
      .first->second;
}

std::vector<LidarConfig> lidars(const std::vector<std::string>& names, const char* preset) {
  std::vector<LidarConfig> out;
  for (const std::string& name : names)
    out.push_back(read_lidar(configs("lidars/" + name + ".yaml"), preset));
  return out;
}

const std::vector<std::string> kRuby{"ruby_plus"};
const std::vector<std::string> kFour{"livox_avia", "helios_16", "pandar_64", "ruby_plus"};
const std::vector<std::string> kSteady{"duration_s=20", "traffic.warm_up_s=30"};

std::vector<std::string> with(const std::vector<std::string>& more) {
  std::vector<std::string> all = kSteady;
  all.insert(all.end(), more.begin(), more.end());
  return all;
}

/// The scene of one frame, made with Embree alone: static triangles and moving instances.
class BareScene {
 public:
  BareScene(const World& w, int k)
      : device_(rtcNewDevice("threads=1")), scene_(rtcNewScene(device_)) {
    rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
    for (const TriangleMesh& mesh : w.meshes->bodies) bodies_.push_back(mesh_scene(mesh));
    bodies_.push_back(mesh_scene(w.background()));
    for (const MovingObject& o : w.objects_in_frame(k, kUsualPeriod_s)) {
      std::size_t body = 0;
      while (kObjectClasses[body].id != o.object_class) ++body;
      RTCGeometry instance = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_INSTANCE);
      rtcSetGeometryInstancedScene(instance, bodies_[body]);
      rtcSetGeometryTimeStepCount(instance, 2);
      set_pose(instance, 0, w.level.to_level(o.from));
      set_pose(instance, 1, w.level.to_level(o.to));
      attach(instance);
    }
    RTCGeometry background = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_INSTANCE);
    rtcSetGeometryInstancedScene(background, bodies_.back());
    attach(background);
    rtcCommitScene(scene_);
  }
  ~BareScene() {
    rtcReleaseScene(scene_);
    for (RTCScene body : bodies_) rtcReleaseScene(body);
    rtcReleaseDevice(device_);
  }
  BareScene(const BareScene&) = delete;
  BareScene& operator=(const BareScene&) = delete;

  /// Casts packets of 16 rays in firing order. Returns a sum, so that the compiler keeps the casts.
  float cast(const RayBatch& rays) const {
    float sum = 0;
    alignas(64) std::array<int, 16> valid;
    valid.fill(-1);
    RTCRayHit16 rh;
    for (std::size_t first = 0; first + 16 <= rays.size(); first += 16) {
      for (std::size_t i = 0; i < 16; ++i) {
        rh.ray.org_x[i] = rh.ray.org_y[i] = rh.ray.org_z[i] = 0;
        rh.ray.dir_x[i] = rays.dx[first + i];
        rh.ray.dir_y[i] = rays.dy[first + i];
        rh.ray.dir_z[i] = rays.dz[first + i];
        rh.ray.tnear[i] = 0;
        rh.ray.tfar[i] = rays.max_range;
        rh.ray.time[i] = std::clamp(rays.time[first + i] * 10, 0.0F, 1.0F);
        rh.ray.mask[i] = 0xFFFFFFFFU;
        rh.ray.flags[i] = 0;
        rh.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
        rh.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
      }
      intersect16(valid.data(), scene_, rh);
      sum += rh.ray.tfar[0];
    }
    return sum;
  }

 private:
  RTCScene mesh_scene(const TriangleMesh& mesh) const {
    RTCScene scene = rtcNewScene(device_);
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    RTCGeometry g = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* v = static_cast<float*>(rtcSetNewGeometryBuffer(
        g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, mesh.vertices.size()));
    auto* t = static_cast<unsigned*>(rtcSetNewGeometryBuffer(
        g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, mesh.triangles.size()));
    for (const auto& vertex : mesh.vertices) v = std::copy(vertex.begin(), vertex.end(), v);
    for (const auto& triangle : mesh.triangles) t = std::copy(triangle.begin(), triangle.end(), t);
    rtcCommitGeometry(g);
    rtcAttachGeometry(scene, g);
    rtcReleaseGeometry(g);
    rtcCommitScene(scene);
    return scene;
  }
  static void set_pose(RTCGeometry instance, unsigned step, const Box3d& b) {
    RTCQuaternionDecomposition q;
    rtcInitQuaternionDecomposition(&q);
    rtcQuaternionDecompositionSetScale(&q, static_cast<float>(b.dx), static_cast<float>(b.dy),
                                       static_cast<float>(b.dz));
    rtcQuaternionDecompositionSetQuaternion(&q, static_cast<float>(std::cos(b.heading / 2)), 0, 0,
                                            static_cast<float>(std::sin(b.heading / 2)));
    rtcQuaternionDecompositionSetTranslation(&q, static_cast<float>(b.x), static_cast<float>(b.y),
                                             static_cast<float>(b.z));
    rtcSetGeometryTransformQuaternion(instance, step, &q);
  }
  void attach(RTCGeometry geometry) const {
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene_, geometry);
    rtcReleaseGeometry(geometry);
  }

  RTCDevice device_;
  RTCScene scene_;
  std::vector<RTCScene> bodies_;
};

void bare_loop(benchmark::State& state) {
  const World& w = world(kSteady);
  const LidarConfig lidar = lidars(kRuby, "paper").front();
  const LidarUnit& unit = lidar.units.front();
  const ScanPattern pattern(unit.pattern, 0, rotation(0, 0, 0), 0);
  std::vector<std::unique_ptr<BareScene>> scenes;
  std::vector<RayBatch> rays(kFrames);
  for (int k = 0; k < kFrames; ++k) {
    scenes.push_back(std::make_unique<BareScene>(w, k));
    pattern.generate(pattern.fired_between(k * kUsualPeriod_s, (k + 1) * kUsualPeriod_s),
                     k * kUsualPeriod_s, rays[k]);
    rays[k].max_range = static_cast<float>(unit.returns.max_range_m);
  }
  std::int64_t cast = 0;
  for (auto _ : state)
    for (int k = 0; k < kFrames; ++k) {
      benchmark::DoNotOptimize(scenes[k]->cast(rays[k]));
      cast += static_cast<std::int64_t>(rays[k].size());
    }
  state.SetItemsProcessed(cast);
}

/// Measures the whole computation of frames, without writing files.
void pipeline(benchmark::State& state, const std::vector<std::string>& names,
              const std::vector<std::string>& overrides, const char* preset, bool format) {
  const World& w = world(with(overrides));
  FrameSimulator simulator(w, lidars(names, preset));
  const std::vector<bool> wanted(names.size(), true);
  std::int64_t cast = 0;
  for (auto _ : state)
    for (int k = 0; k < kFrames; ++k)
      for (const Frame& frame : simulator.simulate(k, wanted)) {
        if (format) {
          benchmark::DoNotOptimize(label_text(frame.objects, false, LabelTime::kScan));
          benchmark::DoNotOptimize(objects_csv(frame.objects));
          benchmark::DoNotOptimize(fields_bytes(frame.cloud));
          benchmark::DoNotOptimize(velodyne_bytes(frame.cloud));
        }
        cast += static_cast<std::int64_t>(frame.rays);
      }
  state.SetItemsProcessed(cast);
}

/// Measures the stages of a LiDAR's frames, in nanoseconds per ray.
void stages(benchmark::State& state, const std::string& name, const char* preset) {
  const World& w = world(kSteady, preset);
  const std::vector<LidarConfig> lidar = lidars({name}, preset);
  FrameSimulator simulator(w, lidar);
  StageTimes times;
  simulator.measure(times);
  std::size_t rays = 0;
  for (auto _ : state)
    for (int k = 0; k < kFrames; ++k) rays += simulator.simulate(k, {true}).front().rays;
  for (std::size_t i = 0; i < kStageNames.size(); ++i)
    state.counters[std::string(kStageNames[i])] =
        1e9 * times.seconds()[i] / static_cast<double>(rays);
  state.SetItemsProcessed(static_cast<std::int64_t>(rays));
}

void add(const char* name, const std::vector<std::string>& names,
         const std::vector<std::string>& overrides, int threads, const char* preset = "paper",
         bool format = false) {
  benchmark::RegisterBenchmark(name, pipeline, names, overrides, preset, format)
      ->Threads(threads)
      ->UseRealTime();
}

}  // namespace

int main(int argc, char** argv) {
  mallopt(M_MMAP_THRESHOLD, 1 << 28);  // as the binary does
  mallopt(M_TRIM_THRESHOLD, 1 << 28);
  benchmark::RegisterBenchmark("bare_loop", bare_loop)->Threads(2)->UseRealTime();
  add("pipeline_128", kRuby, {}, 2, "paper", true);
  add("pipeline_128_equal", kRuby, {}, 2, "equal", true);
  add("pipeline_128_datasheet", kRuby, {}, 2, "datasheet", true);
  add("pipeline_avia_datasheet", {"livox_avia"}, {}, 2, "datasheet", true);
  for (const char* preset : {"paper", "datasheet"})
    for (const char* name : {"ruby_plus", "livox_avia"})
      benchmark::RegisterBenchmark(("stages_" + std::string(name) + "_" + preset).c_str(), stages,
                                   name, preset);
  add("four_exact", kFour, {}, 1);
  add("four_exact", kFour, {}, 2);
  add("four_slices_100", kFour, {"aggregation=slices:100"}, 2);
  add("four_instant", kFour, {"aggregation=instant"}, 2);
  add("detail_mid", kFour, {"detail=mid"}, 2);
  add("detail_fine", kFour, {"detail=fine"}, 2);
  add("density_4", kFour, {"traffic.vehicles_per_km_lane=4"}, 2);
  add("density_40", kFour, {"traffic.vehicles_per_km_lane=40"}, 2);
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
