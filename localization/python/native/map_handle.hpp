#pragma once

#include <stillmap/maps/map_package.hpp>

#include <memory>

namespace stillmap::python {

/// What Python's Map holds: pybind11 keeps no pointers to const.
struct MapHandle {
  std::shared_ptr<const maps::MapPackage> package;
};

}  // namespace stillmap::python
