#include "infrasim/pipeline/observer.h"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <array>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "bindings.h"
#include "infrasim/config/fields.h"
#include "infrasim/core/errors.h"

namespace infrasim {

namespace py = pybind11;

namespace {

/// One object seen by one LiDAR in one frame. The struct is a NumPy record in Python.
struct ObservationRow {
  std::int32_t frame, lidar, id, points;
  double along, across, up, distance, visibility;
};

/// One object in the evaluation region, in the world frame. The struct is a NumPy record in Python.
struct PresentRow {
  std::int32_t frame, id;
  std::uint16_t class_id;
  double x, y, z, dx, dy, dz, heading, speed;
};

/// @throws ConfigError for a number that is not finite or too large
MountConfig pose_of(const std::array<double, 5>& pose) {
  constexpr std::array kNames{"x_m", "y_m", "z_m", "yaw_deg", "pitch_deg"};
  constexpr std::array kMost{1e6, 1e6, 1e4, 360.0, 90.0};
  for (std::size_t i = 0; i < pose.size(); ++i)
    if (!(std::abs(pose[i]) <= kMost[i]))
      throw ConfigError(std::string(kNames[i]) + ": expected -" + config::number_text(kMost[i]) +
                        " to " + config::number_text(kMost[i]) + ", got " +
                        config::number_text(pose[i]));
  const auto& [x, y, z, yaw, pitch] = pose;
  MountConfig mount;
  mount.x_m = x;
  mount.y_m = y;
  mount.z_m = z;
  mount.yaw_deg = yaw;
  mount.pitch_deg = pitch;
  return mount;
}

py::array observed(const Observer& observer, const std::array<double, 5>& pose,
                   const std::vector<LidarConfig>& lidars, const std::vector<int>& frames) {
  const auto per_frame =
      without_lock([&] { return observer.observe(pose_of(pose), lidars, frames); });
  std::vector<ObservationRow> rows;
  for (std::size_t k = 0; k < frames.size(); ++k)
    for (std::size_t i = 0; i < lidars.size(); ++i)
      for (const Observation& o : per_frame[k][i])
        rows.push_back({frames[k], static_cast<std::int32_t>(i), o.id, o.points.points,
                        o.points.along_m, o.points.across_m, o.points.up_m, o.distance,
                        o.visibility});
  return py::array_t<ObservationRow>(static_cast<py::ssize_t>(rows.size()), rows.data());
}

py::array present(const Observer& observer, const std::vector<int>& frames) {
  std::vector<PresentRow> rows;
  for (const int k : frames)
    for (const MovingObject& o : observer.present(k)) {
      const Box3d b = o.at(0.5);
      rows.push_back({k, o.id, static_cast<std::uint16_t>(o.object_class), b.x, b.y, b.z, b.dx,
                      b.dy, b.dz, b.heading, o.speed_m_s});
    }
  return py::array_t<PresentRow>(static_cast<py::ssize_t>(rows.size()), rows.data());
}

}  // namespace

void bind_observer(py::module_& m) {
  PYBIND11_NUMPY_DTYPE(ObservationRow, frame, lidar, id, points, along, across, up, distance,
                       visibility);
  PYBIND11_NUMPY_DTYPE(PresentRow, frame, id, class_id, x, y, z, dx, dy, dz, heading, speed);
  py::class_<Observer>(
      m, "Observer",
      "What LiDARs see of the objects of one site from many poses. A pose is x, y, "
      "z (m, world frame), yaw and pitch (deg). Thread-safe.")
      .def(py::init([](const std::string& file, const std::vector<std::string>& set,
                       const std::string& preset, const std::string& mount,
                       const std::vector<int>& frames, double period_s) {
             const py::gil_scoped_release release;
             check_period(period_s);
             return std::make_unique<Observer>(read_scene(file, set, preset), mount, frames,
                                               period_s);
           }),
           py::arg("file"), py::arg("assignments"), py::arg("preset"), py::arg("mount"),
           py::arg("frames"), py::arg("period_s") = kUsualPeriod_s)
      .def(
          "fault",
          [](const Observer& o, const std::array<double, 5>& pose) {
            const py::gil_scoped_release release;
            return o.fault(pose_of(pose));
          },
          py::arg("pose"), "Returns why no sensor can be at a pose; empty if one can.")
      .def(
          "observe", &observed, py::arg("pose"), py::arg("lidars"), py::arg("frames"),
          "Returns (n,) structured: each object with points, by frame and LiDAR. Extents are along "
          "the axes of the object's box. Raises ConfigError for a pose with a fault.")
      .def("present", &present, py::arg("frames"),
           "Returns (n,) structured: every object in the evaluation region at the middle of each "
           "frame. World frame.");
}

}  // namespace infrasim
