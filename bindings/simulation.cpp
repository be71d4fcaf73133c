#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <array>
#include <memory>
#include <vector>

#include "bindings.h"
#include "infrasim/config/fields.h"
#include "infrasim/config/lidar_changes.h"
#include "infrasim/config/lidar_checks.h"
#include "infrasim/pipeline/frame_stream.h"
#include "infrasim/pipeline/run_folder.h"
#include "infrasim/sensor/pattern_period.h"
#include "infrasim/sensor/pattern_table.h"
#include "infrasim/sensor/return_model.h"

namespace infrasim {

namespace py = pybind11;

namespace {

/// @throws ConfigError unless 0 <= first_frame < last_frame and step >= 1
void check_frames(int first_frame, int last_frame, int step) {
  if (first_frame < 0 || last_frame <= first_frame || step < 1)
    throw ConfigError("frames: expected A:B:STEP with 0 <= A < B and STEP >= 1, got " +
                      std::to_string(first_frame) + ":" + std::to_string(last_frame) + ":" +
                      std::to_string(step));
}

py::array_t<double> pattern_rays(const LidarConfig& lidar, int first_frame, int last_frame,
                                 int step, std::optional<std::uint64_t> seed,
                                 const std::string& mount) {
  check_frames(first_frame, last_frame, step);
  const std::vector<double> rows = without_lock(
      [&] { return pattern_table(lidar, first_frame, last_frame, step, seed, mount); });
  return py::array_t<double>({static_cast<py::ssize_t>(rows.size() / 3), py::ssize_t{3}},
                             rows.data());
}

std::pair<py::array_t<float>, py::array_t<std::uint32_t>> mesh_arrays(const World& world, int frame,
                                                                      double share,
                                                                      double period_s) {
  check_period(period_s);
  if (!(share >= 0 && share <= 1))
    throw ConfigError("share: expected 0 to 1, got " + config::number_text(share));
  const TriangleMesh mesh =
      without_lock([&] { return frozen_mesh(world, frame, period_s, share); });
  return {
      py::array_t<float>({static_cast<py::ssize_t>(mesh.vertices.size()), py::ssize_t{3}},
                         mesh.vertices.data()->data()),
      py::array_t<std::uint32_t>({static_cast<py::ssize_t>(mesh.triangles.size()), py::ssize_t{3}},
                                 mesh.triangles.data()->data())};
}

/// Returns a copy of the LiDAR that detects every hit within its range limits, without range noise.
LidarConfig with_every_hit(LidarConfig lidar) {
  for (LidarUnit& unit : lidar.units) {
    ReturnsConfig& returns = unit.returns;
    returns = {.min_range_m = returns.min_range_m,
               .max_range_m = returns.max_range_m,
               .range_accuracy_m = 0,
               .drop_off = std::nullopt,
               .detection = returns.detection,
               .beam = std::nullopt,
               .echoes = std::nullopt,
               .every_hit = true};
    if (!returns.detection) continue;
    // Detection stays enabled, because it determines how intensities are computed.
    returns.detection->range_at_10_percent_m = kLongestPublishedRange_m;
    returns.detection->further_ranges.clear();
    returns.detection->law_exponent = kLeastExponent;
    if (!unit.pattern.spinning) continue;
    for (Channel& channel : unit.pattern.spinning->channels.table)
      channel.range_at_10_percent_m.reset();
  }
  return lidar;
}

/// One object of the scene. The struct is a NumPy record in Python.
struct SceneObject {
  std::int32_t id;
  std::uint16_t class_id;
  double x, y, z, dx, dy, dz, heading, speed;
};

py::array object_array(const World& world, int frame, double period_s) {
  check_period(period_s);
  if (const int frames = world.frames(period_s); frame < 0 || frame >= frames)
    throw ConfigError("frame: expected 0 to " + std::to_string(frames - 1) + ", got " +
                      std::to_string(frame));
  const std::vector<MovingObject> objects =
      without_lock([&] { return world.objects_in_frame(frame, period_s); });
  py::array_t<SceneObject> rows(static_cast<py::ssize_t>(objects.size()));
  auto out = rows.mutable_unchecked<1>();
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const MovingObject& o = objects[i];
    const Box3d b = world.level.to_level(o.at(0.5));
    out(static_cast<py::ssize_t>(i)) = {o.id,      static_cast<std::uint16_t>(o.object_class),
                                        b.x,       b.y,
                                        b.z,       b.dx,
                                        b.dy,      b.dz,
                                        b.heading, o.speed_m_s};
  }
  return rows;
}

}  // namespace

void check_period(double period_s) {
  if (!(period_s >= kShortestPeriod_s && period_s <= kLongestPeriod_s))
    throw ConfigError("period_s: expected " + config::number_text(kShortestPeriod_s) + " to " +
                      config::number_text(kLongestPeriod_s) + ", got " +
                      config::number_text(period_s));
}

void bind_simulation(py::module_& m) {
  PYBIND11_NUMPY_DTYPE(SceneObject, id, class_id, x, y, z, dx, dy, dz, heading, speed);
  py::class_<LidarConfig>(m, "Lidar", "One preset of a LiDAR file.")
      .def(py::init([](const std::string& file, const std::string& preset) {
             return read_lidar(file, preset);
           }),
           py::arg("file"), py::arg("preset"))
      .def(
          "with_free_motors",
          [](LidarConfig lidar) {
            for (LidarUnit& unit : lidar.units)
              if (unit.pattern.spinning) unit.pattern.spinning->phase = MotorPhase::kFree;
            return lidar;
          },
          "Returns a copy whose spinning motors start at random angles, derived from "
          "the scene's seed.")
      .def("with_every_hit", &with_every_hit,
           "Returns a copy in which each ray that hits something within the maximum range gives a "
           "point at the exact range: without loss, noise, width of the beam and further echoes.")
      .def("with_rate", &with_rate, py::arg("rate_hz"),
           "Returns a copy with another number of frames per second, 5 to 20. The firing cycle of "
           "a spinning LiDAR does not change, so that its columns per turn do.")
      .def_property_readonly(
          "period_s", [](const LidarConfig& lidar) { return period_s(lidar); },
          "Frame period in seconds.")
      .def(
          "with_law_exponent",
          [](LidarConfig lidar, double exponent) {
            set_law_exponent(lidar, exponent);
            return lidar;
          },
          py::arg("exponent"),
          "Returns a copy whose range grows in full sun with this power of the reflectance, 0.25 "
          "to "
          "0.5. Units with several published ranges keep the exponent that these determine.")
      .def(
          "with_echo",
          [](LidarConfig lidar, const std::string& mode) {
            set_echo_mode(lidar, echo_mode(mode));
            return lidar;
          },
          py::arg("mode"),
          "Returns a copy whose rays give the strongest, first or last echo as a point, or two "
          "(dual).")
      .def(
          "period_warnings",
          [](const LidarConfig& lidar, int first_frame, int last_frame, int step) {
            check_frames(first_frame, last_frame, step);
            return period_warnings({lidar}, first_frame, last_frame, step);
          },
          py::arg("first_frame"), py::arg("last_frame"), py::arg("step"),
          "Returns one warning if frames with this step show less of the scan pattern "
          "than other steps would, else none.")
      .def(
          "fields_of_view",
          [](const LidarConfig& lidar) {
            std::vector<std::array<double, 4>> views;
            for (const FieldOfView& view : fields_of_view(lidar))
              views.push_back({view.azimuth_min_deg, view.azimuth_max_deg, view.elevation_min_deg,
                               view.elevation_max_deg});
            return views;
          },
          "Returns azimuth minimum and maximum, then elevation minimum and maximum (deg) of the "
          "rays of each unit.")
      .def_readonly("name", &LidarConfig::name)
      .def_readonly("preset", &LidarConfig::preset)
      .def("dump", &dump_lidar, "Returns every key with its value, as YAML.")
      .def("pattern", &pattern_rays, py::arg("first_frame"), py::arg("last_frame"), py::arg("step"),
           py::arg("seed") = py::none(), py::arg("mount") = kUsualMount,
           "Returns (n, 3) float64: azimuth, elevation (rad) and time (s) of every ray, "
           "column by column, sensor frame. Without a seed, free motors start as if "
           "locked.");

  py::class_<World>(m, "World", "A scene that is ready to simulate.")
      .def(py::init([](const std::string& file, const std::vector<std::string>& set,
                       const std::string& preset, const std::string& mount) {
             const py::gil_scoped_release release;
             return std::make_unique<World>(build_lazy_world(read_scene(file, set, preset), mount));
           }),
           py::arg("file"), py::arg("assignments") = std::vector<std::string>{},
           py::arg("preset") = "datasheet", py::arg("mount") = "")
      .def_static(
          "of_text",
          [](const std::string& text, const std::string& name, const std::string& preset,
             const std::string& mount) {
            const py::gil_scoped_release release;
            return std::make_unique<World>(
                build_lazy_world(parse_scene(text, name, preset), mount));
          },
          py::arg("text"), py::arg("name"), py::arg("preset") = "datasheet", py::arg("mount") = "",
          "Makes a scene from YAML text. Messages use name in place of a file name.")
      .def(
          "roads_csv", [](const World& w) { return w.region.roads_csv(); },
          "Returns the evaluation region in the format of roads.csv.")
      .def(
          "regions_csv", [](const World& w) { return w.region.regions_csv(); },
          "Returns the outlines that narrow the region, in the format of regions.csv. "
          "Empty without outlines.")
      .def("lidar_yaml", &lidar_yaml, py::arg("lidar"),
           "Returns the content of lidar.yaml for a LiDAR in this scene.")
      .def("objects", &object_array, py::arg("frame"), py::arg("period_s") = kUsualPeriod_s,
           "Returns (k,) structured: every object of the scene at the middle of a frame, "
           "at any distance. Levelled frame.")
      .def(
          "dump", [](const World& w) { return dump_scene(w.scene); },
          "Returns every key with its value, as YAML.")
      .def(
          "label_time",
          [](const World& w, const std::string& preset) {
            return enum_names(
                LabelTime{})[static_cast<std::size_t>(label_time_of(w.scene, preset))];
          },
          py::arg("preset"), "Returns the label time of a preset: frame or scan.")
      .def_property_readonly(
          "frames", [](const World& w) { return w.frames(kUsualPeriod_s); },
          "Number of frames of 0.1 s in the scene's duration.")
      .def(
          "frames_of",
          [](const World& w, double period_s) {
            check_period(period_s);
            return w.frames(period_s);
          },
          py::arg("period_s"), "Returns the number of frames of a period in the scene's duration.")
      .def(
          "drive",
          [](const World& w) {
            if (w.lazy_trajectories) w.lazy_trajectories->drive();
          },
          py::call_guard<py::gil_scoped_release>(),
          "Simulates the traffic of the whole scene, which is otherwise simulated up to the last "
          "frame that was requested. Raises ConfigError if a vehicle hits the sensor.")
      .def("mesh", &mesh_arrays, py::arg("frame"), py::arg("share") = 0.5,
           py::arg("period_s") = kUsualPeriod_s,
           "Returns all triangles at one instant of a frame: (n, 3) float32 vertices and "
           "(m, 3) uint32 vertex indices. Levelled frame. share: 0 at the start of the "
           "frame, 1 at its end.");

  m.def(
      "warnings",
      [](const World& w, const std::vector<LidarConfig>& lidars) {
        std::vector<std::string> lines = weather_warnings(w.scene.weather, lidars);
        const std::vector<std::string> own = lidar_warnings(lidars);
        lines.insert(lines.end(), own.begin(), own.end());
        lines.insert(lines.end(), w.warnings.begin(), w.warnings.end());
        return lines;
      },
      py::arg("world"), py::arg("lidars"),
      "Returns warnings about these LiDARs, one line each: tables of angles that look like "
      "radians or repeat too soon, and a weather model without effect. Then returns those about "
      "the world's "
      "trajectories and meshes.");

  py::class_<FrameStream>(m, "FrameStream",
                          "Iterates over (number, [Frame per LiDAR]), computed ahead by threads.")
      .def(py::init<const World&, const std::vector<LidarConfig>&, std::vector<int>, int>(),
           py::arg("world"), py::arg("lidars"), py::arg("frames"), py::arg("threads"),
           py::keep_alive<1, 2>(), py::call_guard<py::gil_scoped_release>())
      .def("__iter__", [](py::object self) { return self; })
      .def("__next__", [](FrameStream& stream) {
        auto item = without_lock([&] { return stream.next(); });
        if (!item) throw py::stop_iteration();
        std::vector<std::shared_ptr<Frame>> frames;
        for (Frame& frame : item->second)
          frames.push_back(std::make_shared<Frame>(std::move(frame)));
        return std::pair{item->first, std::move(frames)};
      });
}

}  // namespace infrasim
