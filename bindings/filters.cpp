#include "infrasim/filter/filter.h"

#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <array>
#include <cctype>

#include "bindings.h"
#include "infrasim/config/filter_declarations.h"
#include "infrasim/core/errors.h"
#include "infrasim/core/files.h"
#include "infrasim/io/atomic_file.h"

namespace infrasim {

namespace py = pybind11;

namespace {

// maximum number of points; row numbers must fit into int32, and 12 bytes per point are copied
constexpr py::ssize_t kMostPoints = py::ssize_t{1} << 28;

/// Returns the row-major x y z of a float32 array with 3 or more columns.
/// @throws ConfigError for another shape or type
std::vector<float> xyz_of(const py::array& points) {
  if (!py::isinstance<py::array_t<float>>(points) || points.ndim() != 2 || points.shape(1) < 3) {
    const auto shape = py::str(points.attr("shape")).cast<std::string>();
    const auto type = py::str(points.dtype()).cast<std::string>();
    throw ConfigError("points: expected (n, 3) or (n, 4) float32, got " + shape + " " + type);
  }
  if (points.shape(0) > kMostPoints)
    throw ConfigError("points: expected up to " + std::to_string(kMostPoints) + " rows, got " +
                      std::to_string(points.shape(0)));
  const auto rows = py::cast<py::array_t<float>>(points).unchecked<2>();
  std::vector<float> xyz;
  xyz.reserve(static_cast<std::size_t>(3 * rows.shape(0)));
  for (py::ssize_t i = 0; i < rows.shape(0); ++i)
    xyz.insert(xyz.end(), {rows(i, 0), rows(i, 1), rows(i, 2)});
  return xyz;
}

py::array_t<int> kept_rows(const py::array& points, const std::vector<FilterStep>& steps) {
  const std::vector<float> xyz = xyz_of(points);
  const std::vector<int> kept = without_lock([&] { return keep_all(steps, xyz); });
  return py::array_t<int>(static_cast<py::ssize_t>(kept.size()), kept.data());
}

BackgroundModel learnt(const std::vector<py::array>& frames, const BackgroundLearning& learning) {
  std::vector<std::vector<float>> clouds;
  for (const py::array& frame : frames) clouds.push_back(xyz_of(frame));
  const py::gil_scoped_release release;
  return learn_background(clouds, learning);
}

/// Converts a parameter's value from its Python type; most types need no conversion.
const auto& from_python(const auto& value) { return value; }
std::vector<Vec2> from_python(const std::vector<std::pair<double, double>>& corners) {
  std::vector<Vec2> out;
  for (const auto& [x, y] : corners) out.push_back({x, y});
  return out;
}
template <class T>
using InPython = std::conditional_t<std::is_same_v<T, std::vector<Vec2>>,
                                    std::vector<std::pair<double, double>>, T>;

template <bool kWithDefault, class Filter, class Parameter>
auto argument(const Filter& standard, const Parameter& parameter) {
  if constexpr (kWithDefault)
    return py::arg(parameter.name) = standard.*parameter.member;
  else
    return py::arg(parameter.name);
}

/// Converts the name of a filter to the name of a class, such as crop_box to CropBox.
std::string class_name(std::string_view key) {
  std::string name;
  for (bool upper = true; const char c : key) {
    if (c != '_') name += upper ? static_cast<char>(std::toupper(c)) : c;
    upper = c == '_';
  }
  return name;
}

/// Makes a function that builds a filter from its parameters in Python types.
template <class Filter, class... T, bool... kRequired>
auto factory(const config::Parameter<Filter, T, kRequired>&... parameters) {
  return [parameters...](const InPython<T>&... values) {
    Filter filter;
    ((filter.*parameters.member = from_python(values)), ...);
    return filter;
  };
}

/// Binds a filter as a class whose parameters are those of its declaration, in their order.
template <class Filter, class... T, bool... kRequired, std::size_t... I>
void bind_filter(
    py::module_& m,
    const config::FilterDeclaration<config::Parameter<Filter, T, kRequired>...>& declared,
    std::index_sequence<I...>) {
  // Python requires parameters without a default first.
  constexpr std::size_t kFirstDefault = std::max({kRequired ? I + 1 : 0 ...});
  const auto make = std::apply([](const auto&... p) { return factory(p...); }, declared.parameters);
  py::class_<Filter>(m, class_name(declared.key).c_str(), declared.docstring)
      .def(py::init(make),
           argument<(I >= kFirstDefault)>(Filter{}, std::get<I>(declared.parameters))...);
}

/// Binds the background filter as a model that is learnt from frames. The number of frames is not a
/// parameter in Python.
template <class... T>
void bind_background(
    py::module_& m,
    const config::FilterDeclaration<config::Parameter<BackgroundFilter, int, false>,
                                    config::Parameter<BackgroundLearning, T, false>...>& declared) {
  py::class_<BackgroundModel>(m, "BackgroundModel", declared.docstring)
      .def(
          "save",
          [](const BackgroundModel& model, const std::string& file) {
            write_file_atomically(file, background_to_bytes(model));
          },
          py::arg("file"), "Writes a file for `infrasim filter --background`.")
      .def_static(
          "load",
          [](const std::string& file) { return background_from_bytes(read_file(file), file); },
          py::arg("file"),
          "Reads a saved model. Raises ConfigError if the file is not a complete model.");
  std::apply(
      [&](const auto&, const config::Parameter<BackgroundLearning, T, false>&... parameters) {
        const auto learn = [parameters...](const std::vector<py::array>& frames, T... values) {
          BackgroundLearning learning;
          ((learning.*parameters.member = values), ...);
          return learnt(frames, learning);
        };
        m.def("learn_background", learn, py::arg("frames"), py::kw_only(),
              argument<true>(BackgroundLearning{}, parameters)...,
              "Learns a BackgroundModel from frames of one fixed sensor, each (n, 3) or (n, "
              "4) float32, levelled LiDAR frame. Raises ValueError.");
      },
      declared.parameters);
}

}  // namespace

void bind_filters(py::module_& m) {
  config::for_each_filter(
      config::Of<FilterOf<BackgroundFilter>>{}, [&]<class Filter>(config::Of<Filter> filter) {
        const auto declared = config::declaration(filter);
        constexpr auto kParameters = std::tuple_size_v<decltype(declared.parameters)>;
        if constexpr (std::is_same_v<Filter, BackgroundFilter>)
          bind_background(m, declared);
        else
          bind_filter(m, declared, std::make_index_sequence<kParameters>());
      });
  m.def("kept_rows", &kept_rows, py::arg("points"), py::arg("steps"),
        "Returns (k,) int32, increasing: the rows of points that every step keeps, "
        "without rows that are not finite or 0 0 0. points: (n, 3) or (n, 4) float32, "
        "levelled LiDAR frame. Raises ValueError.");
}

}  // namespace infrasim
