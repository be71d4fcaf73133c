#pragma once

#include <pybind11/pybind11.h>

namespace infrasim {

// Each function adds the Python bindings of one part of the library. The stub pyinfra/_core.pyi
// describes the result in Python.
void bind_filters(pybind11::module_& m);
void bind_frames(pybind11::module_& m);
void bind_observer(pybind11::module_& m);
void bind_pointops(pybind11::module_& m);
void bind_simulation(pybind11::module_& m);

/// @throws ConfigError for a frame period that is too short or too long for a LiDAR
void check_period(double period_s);

/// Runs work without Python's global lock and returns its result.
template <class Work>
auto without_lock(const Work& work) {
  const pybind11::gil_scoped_release release;
  return work();
}

}  // namespace infrasim
