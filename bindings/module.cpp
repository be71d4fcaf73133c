#include <pybind11/pybind11.h>

#include "infrasim/version.h"

PYBIND11_MODULE(_core, m) {
  m.doc() = "Compiled part of pyinfra; use pyinfra.sim.";
  m.def("version", &infrasim::version, "Version of the simulator.");
}
