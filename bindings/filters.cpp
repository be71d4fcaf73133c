#include "infrasim/filter/filter.h"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include "bindings.h"
#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/io/atomic_file.h"

namespace infrasim {

namespace py = pybind11;

namespace {

/// Row-major x y z of an array (n, 3) or more columns, float32.
/// @throws ConfigError for another shape or type
std::vector<float> xyz_of(const py::array& points) {
  if (!py::isinstance<py::array_t<float>>(points) || points.ndim() != 2 || points.shape(1) < 3) {
    const auto shape = py::str(points.attr("shape")).cast<std::string>();
    const auto type = py::str(points.dtype()).cast<std::string>();
    throw ConfigError("points: found " + shape + " " + type + ", allowed (n, 3) or (n, 4) float32");
  }
  const auto rows = py::cast<py::array_t<float>>(points).unchecked<2>();
  std::vector<float> xyz;
  xyz.reserve(static_cast<std::size_t>(3 * rows.shape(0)));
  for (py::ssize_t i = 0; i < rows.shape(0); ++i)
    xyz.insert(xyz.end(), {rows(i, 0), rows(i, 1), rows(i, 2)});
  return xyz;
}

py::array_t<int> kept_rows(const py::array& points, const std::vector<FilterStep>& steps) {
  const std::vector<float> xyz = xyz_of(points);
  const std::vector<int> kept = [&] {
    const py::gil_scoped_release release;
    return keep_all(steps, xyz);
  }();
  return py::array_t<int>(static_cast<py::ssize_t>(kept.size()), kept.data());
}

BackgroundModel learnt(const std::vector<py::array>& frames, const BackgroundLearning& learning) {
  std::vector<std::vector<float>> clouds;
  for (const py::array& frame : frames) clouds.push_back(xyz_of(frame));
  const py::gil_scoped_release release;
  return learn_background(clouds, learning);
}

std::vector<Vec2> outline(const std::vector<std::pair<double, double>>& corners) {
  std::vector<Vec2> out;
  for (const auto& [x, y] : corners) out.push_back({x, y});
  return out;
}

}  // namespace

void bind_filters(py::module_& m) {
  py::class_<CropBox>(m, "CropBox", "Keeps min_m <= point <= max_m, each (x, y, z) in metres.")
      .def(py::init<std::array<double, 3>, std::array<double, 3>>(), py::arg("min_m"),
           py::arg("max_m"));
  py::class_<CropPolygon>(m, "CropPolygon", "Keeps points inside corners (x, y) in metres.")
      .def(py::init([](const std::vector<std::pair<double, double>>& corners) {
             return CropPolygon{outline(corners)};
           }),
           py::arg("outline_m"));
  py::class_<CropRange>(m, "CropRange", "Keeps min_m <= slant range <= max_m.")
      .def(py::init<double, double>(), py::arg("min_m"), py::arg("max_m"));
  const CropFieldOfView view;
  py::class_<CropFieldOfView>(m, "CropFieldOfView",
                              "Keeps an interval of azimuth, from min towards +y up to max, and "
                              "of elevation; degrees.")
      .def(py::init<double, double, double, double>(),
           py::arg("azimuth_min_deg") = view.azimuth_min_deg,
           py::arg("azimuth_max_deg") = view.azimuth_max_deg,
           py::arg("elevation_min_deg") = view.elevation_min_deg,
           py::arg("elevation_max_deg") = view.elevation_max_deg);
  py::class_<GroundHeight>(m, "GroundHeight", "Keeps z > z_m; knows no slope.")
      .def(py::init<double>(), py::arg("z_m"));
  const GroundPlane plane;
  py::class_<GroundPlane>(m, "GroundPlane",
                          "Removes what is within distance_m of the largest plane that is nearly "
                          "level (PCL's RANSAC).")
      .def(py::init<double, double>(), py::arg("distance_m") = plane.distance_m,
           py::arg("max_tilt_deg") = plane.max_tilt_deg);
  const GroundMorphological opening;
  py::class_<GroundMorphological>(
      m, "GroundMorphological",
      "Removes roads, slopes and terrain: what is wider than window_m, and height_m above it.")
      .def(py::init<double, double, double, double, double>(),
           py::arg("window_m") = opening.window_m, py::arg("height_m") = opening.height_m,
           py::arg("cell_m") = opening.cell_m,
           py::arg("azimuth_cell_deg") = opening.azimuth_cell_deg,
           py::arg("max_range_m") = opening.max_range_m);
  py::class_<BackgroundModel>(m, "BackgroundModel",
                              "The static scene as one fixed sensor sees it; as a filter step it "
                              "removes that scene.")
      .def(
          "save",
          [](const BackgroundModel& model, const std::string& file) {
            write_file_atomically(file, background_to_bytes(model));
          },
          py::arg("file"), "Writes what `infrasim filter --background` reads.")
      .def_static(
          "load",
          [](const std::string& file) { return background_from_bytes(read_file(file), file); },
          py::arg("file"), "Raises ConfigError for a file that is not a whole model.");
  const BackgroundLearning learning;
  m.def(
      "learn_background",
      [](const std::vector<py::array>& frames, double azimuth_cell_deg, double elevation_cell_deg,
         double range_margin_m, double height_margin_m) {
        return learnt(frames, {.azimuth_cell_deg = azimuth_cell_deg,
                               .elevation_cell_deg = elevation_cell_deg,
                               .range_margin_m = range_margin_m,
                               .height_margin_m = height_margin_m});
      },
      py::arg("frames"), py::kw_only(), py::arg("azimuth_cell_deg") = learning.azimuth_cell_deg,
      py::arg("elevation_cell_deg") = learning.elevation_cell_deg,
      py::arg("range_margin_m") = learning.range_margin_m,
      py::arg("height_margin_m") = learning.height_margin_m,
      "A BackgroundModel from frames of one sensor in one place, each (n, 3) or (n, 4) float32, "
      "levelled LiDAR frame. Raises ValueError.");
  m.def("kept_rows", &kept_rows, py::arg("points"), py::arg("steps"),
        "(k,) int32, increasing: the rows of points, (n, 3) or (n, 4) float32, levelled LiDAR "
        "frame, that every step keeps; never rows that are not finite. Raises ValueError.");
}

}  // namespace infrasim
