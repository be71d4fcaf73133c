#include "bindings.h"

#include "infrasim/core/errors.h"
#include "infrasim/core/version.h"

PYBIND11_MODULE(_core, m) {
  m.doc() = "Compiled part of pyinfra. Use it through pyinfra.dataset.simulation.";
  m.def("version", &infrasim::version, "Returns the version of the simulator.");
  m.def(
      "frames_version", [] { return infrasim::kFramesVersion; },
      "Returns the version number of the frames. Equal numbers give equal bytes.");
  const auto errors = pybind11::module_::import("pyinfra.core.errors");
  pybind11::register_exception<infrasim::ConfigError>(m, "ConfigError", errors.attr("ConfigError"));
  pybind11::register_exception<infrasim::IoError>(m, "IoError", PyExc_OSError);
  infrasim::bind_filters(m);
  infrasim::bind_frames(m);
  infrasim::bind_pointops(m);
  infrasim::bind_simulation(m);
  infrasim::bind_observer(m);
}
