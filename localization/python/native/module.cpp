#include <stillmap/maps/error.hpp>

#include <pybind11/pybind11.h>

#include "bindings.hpp"

namespace {

/// The class that users catch, known by the name under which they import it.
template <typename Error>
void register_error(pybind11::module_& module, const char* name, PyObject* base,
                    const char* words) {
  pybind11::object error = pybind11::register_exception<Error>(module, name, base);
  error.attr("__module__") = "stillmap";
  error.attr("__doc__") = words;
}

}  // namespace

PYBIND11_MODULE(_native, module) {
  module.doc() = "Maps, drives and localization of stillmap; see the package stillmap.";
  register_error<stillmap::maps::InputError>(
      module, "InputError", PyExc_ValueError,
      "A file that cannot be used: the message names it, what was found and what was expected.");
  register_error<stillmap::maps::StorageError>(module, "StorageError", PyExc_OSError,
                                               "A file that cannot be opened, read or written.");
  stillmap::python::bind_drives(module);
  stillmap::python::bind_maps(module);
  stillmap::python::bind_localization(module);
}
