#pragma once

#include <pybind11/pybind11.h>

namespace infrasim {

// Each binds one area; see the stub pyinfra/_core.pyi for what Python sees.
void bind_filters(pybind11::module_& m);
void bind_frames(pybind11::module_& m);
void bind_pointops(pybind11::module_& m);
void bind_simulation(pybind11::module_& m);

}  // namespace infrasim
