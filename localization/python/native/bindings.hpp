#pragma once

#include <pybind11/pybind11.h>

namespace stillmap::python {

/// Scan, Drive, files of scans and trajectories.
void bind_drives(pybind11::module_& module);
/// Map.
void bind_maps(pybind11::module_& module);
/// Localizer, Session and their answers. After both others, whose types they name.
void bind_localization(pybind11::module_& module);

}  // namespace stillmap::python
