#include <stillmap/maps/map_object.hpp>
#include <stillmap/maps/map_package.hpp>

#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "bindings.hpp"
#include "map_handle.hpp"

namespace stillmap::python {
namespace {

using maps::MapPackage;

/// The part of the map frame that is asked for: its lower bounds belong to it, its upper do not.
struct Region {
  Eigen::Vector3d least = Eigen::Vector3d::Constant(-std::numeric_limits<double>::infinity());
  Eigen::Vector3d most = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity());

  [[nodiscard]] bool contains(const Eigen::Vector3d& p) const {
    return (p.array() >= least.array()).all() && (p.array() < most.array()).all();
  }
  /// Whether a box with both its corners meets it.
  [[nodiscard]] bool meets(const Eigen::AlignedBox3d& box) const {
    return (box.max().array() >= least.array()).all() && (box.min().array() < most.array()).all();
  }
};

Region region_of(const py::object& box) {
  if (box.is_none()) return {};
  const std::string expected =
      "((x, y, z), (x, y, z)) [m] in the map frame, the second beyond the first on each axis";
  const auto array = py::array_t<double, py::array::c_style | py::array::forcecast>::ensure(box);
  if (!array) throw argument_error("box", description_of(box), expected);
  if (array.ndim() != 2 || array.shape(0) != 2 || array.shape(1) != 3)
    throw argument_error("box", description_of(array), expected);
  const auto corners = array.unchecked<2>();
  Region region;
  for (py::ssize_t axis = 0; axis < 3; ++axis) {
    if (!(corners(0, axis) < corners(1, axis)))
      throw argument_error("box", py::str(box).cast<std::string>(), expected);
    region.least(axis) = corners(0, axis);
    region.most(axis) = corners(1, axis);
  }
  return region;
}

/// Points of a region, an array each.
struct Columns {
  std::vector<double> xyz;
  std::vector<float> intensity;
  std::vector<std::uint16_t> observations;
  std::vector<std::uint8_t> kind;
  std::vector<std::int64_t> object, first_scan, last_scan;
};

void add_tile(const MapPackage& map, maps::TileId id, const Region& region, Columns& columns) {
  const std::vector<maps::PointHistory> history = map.history(id);
  const maps::MapTile tile = map.tile(id);
  std::size_t at = 0;
  for (const maps::MapPoint& point : tile) {
    const std::size_t index = at++;
    const Eigen::Vector3d p = tile.position(point);
    if (!region.contains(p)) continue;
    columns.xyz.insert(columns.xyz.end(), p.data(), p.data() + 3);
    columns.intensity.push_back(point.intensity);
    columns.observations.push_back(point.observations);
    columns.kind.push_back(static_cast<std::uint8_t>(point.kind));
    const maps::PointHistory* const more = history.empty() ? nullptr : &history[index];
    columns.object.push_back(more != nullptr ? std::int64_t{more->object} - 1 : -1);
    columns.first_scan.push_back(more != nullptr ? std::int64_t{more->first_scan} : -1);
    columns.last_scan.push_back(more != nullptr ? std::int64_t{more->last_scan} : -1);
  }
}

Columns columns_in(const MapPackage& map, const Region& region) {
  Columns columns;
  for (const maps::TileEntry& tile : map.tiles())
    if (tile.id.level == 0 && region.meets(map.manifest().bounds_of(tile)))
      add_tile(map, tile.id, region, columns);
  return columns;
}

py::dict points_in(const MapHandle& map, const py::object& box) {
  const Region region = region_of(box);
  Columns columns;
  {
    const py::gil_scoped_release release;
    columns = columns_in(*map.package, region);
  }
  const py::ssize_t size = signed_size(columns.kind.size());
  py::dict arrays;
  arrays["xyz"] = array_of(std::move(columns.xyz), {size, 3});
  arrays["intensity"] = array_of(std::move(columns.intensity), {size});
  arrays["observations"] = array_of(std::move(columns.observations), {size});
  arrays["kind"] = array_of(std::move(columns.kind), {size});
  arrays["object"] = array_of(std::move(columns.object), {size});
  arrays["first_scan"] = array_of(std::move(columns.first_scan), {size});
  arrays["last_scan"] = array_of(std::move(columns.last_scan), {size});
  return arrays;
}

/// A row for each placement in the region.
py::list objects_in(const MapHandle& map, const py::object& box) {
  const Region region = region_of(box);
  py::list rows;
  std::int64_t number = -1;
  for (const maps::MapObject& object : map.package->objects()) {
    ++number;
    for (const maps::MapObject::Placement& placement : object.placements) {
      if (!region.contains(placement.centre_map)) continue;
      const Eigen::Vector3d& c = placement.centre_map;
      const Eigen::Vector3d& s = object.size_m;
      rows.append(py::make_tuple(number, std::string(name_of(object.object_class)),
                                 std::string(name_of(object.motion)), placement.scan,
                                 py::make_tuple(c.x(), c.y(), c.z()), placement.yaw_rad,
                                 py::make_tuple(s.x(), s.y(), s.z()), object.score, object.drive,
                                 object.first_scan, object.last_scan, object.first_stamp_ns,
                                 object.last_stamp_ns, object.detections, object.points_removed));
    }
  }
  return rows;
}

maps::TileId tile_id(std::int32_t x, std::int32_t y, std::uint32_t level) {
  return {.level = level, .x = x, .y = y};
}

py::tuple bounds_of(const MapPackage& map) {
  const Eigen::AlignedBox3d& bounds = map.manifest().extent.from_origin;
  const Eigen::Vector3d& origin = map.manifest().origin;
  if (!bounds.isEmpty())
    return py::make_tuple(Eigen::Vector3d(origin + bounds.min()),
                          Eigen::Vector3d(origin + bounds.max()));
  const Eigen::Vector3d nowhere =
      Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity());
  return py::make_tuple(nowhere, Eigen::Vector3d(-nowhere));
}

std::string manifest_text(const MapHandle& map) {
  const std::ifstream file(map.package->folder() / "manifest.json", std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

py::list tiles_of(const MapHandle& map) {
  py::list tiles;
  for (const maps::TileEntry& tile : map.package->tiles())
    if (tile.id.level == 0) tiles.append(py::make_tuple(tile.id.x, tile.id.y));
  return tiles;
}

void bind_map_facts(py::class_<MapHandle>& map) {
  map.def_property_readonly("folder", [](const MapHandle& self) { return self.package->folder(); })
      .def_property_readonly("digest", [](const MapHandle& self) { return self.package->digest(); })
      .def_property_readonly(
          "frame_id", [](const MapHandle& self) { return self.package->manifest().frame_id; })
      .def_property_readonly("origin",
                             [](const py::object& self) {
                               const auto& package = self.cast<MapHandle&>().package;
                               return view_of(package->manifest().origin.data(), {3}, self);
                             })
      .def_property_readonly("bounds",
                             [](const MapHandle& self) { return bounds_of(*self.package); })
      .def_property_readonly(
          "voxel_size_m",
          [](const MapHandle& self) { return self.package->manifest().voxel_size_m; })
      .def_property_readonly("geodetic_origin",
                             [](const MapHandle& self) -> py::object {
                               const auto& origin = self.package->manifest().geodetic_origin;
                               if (!origin) return py::none();
                               return py::make_tuple(origin->latitude_deg, origin->longitude_deg,
                                                     origin->altitude_m);
                             })
      .def_property_readonly("manifest", [](const MapHandle& self) {
        return py::module_::import("json").attr("loads")(manifest_text(self));
      });
}

/// What `read` gives of a package, read while others may use Python.
template <typename Read>
py::array records_of(const MapHandle& map, const Read& read) {
  auto records = [&] {
    const py::gil_scoped_release release;
    return read(*map.package);
  }();
  const py::ssize_t size = signed_size(records.size());
  return array_of(std::move(records), {size});
}

}  // namespace

void bind_maps(py::module_& module) {
  PYBIND11_NUMPY_DTYPE(maps::MapPoint, x, y, z, intensity, observations, kind, object);
  PYBIND11_NUMPY_DTYPE(maps::PointHistory, first_scan, last_scan, object, normal, planarity);
  py::class_<MapHandle> map(module, "Map", R"(One version of a map, read in place.)");
  bind_map_facts(map);
  map.def_property_readonly("tiles", &tiles_of)
      .def(
          "tile",
          [](const MapHandle& self, std::int32_t x, std::int32_t y, std::uint32_t level) {
            return records_of(self, [&](const MapPackage& package) {
              const maps::TileId id = tile_id(x, y, level);
              return package.tile(id).points_from(maps::corner_of(id));
            });
          },
          py::arg("x"), py::arg("y"), py::kw_only(), py::arg("level") = 0)
      .def(
          "tile_corner",
          [](const MapHandle& self, std::int32_t x, std::int32_t y, std::uint32_t level) {
            const Eigen::Vector3d& origin = self.package->manifest().origin;
            return Eigen::Vector3d(origin + maps::corner_of(tile_id(x, y, level)));
          },
          py::arg("x"), py::arg("y"), py::kw_only(), py::arg("level") = 0)
      .def(
          "tile_history",
          [](const MapHandle& self, std::int32_t x, std::int32_t y, std::uint32_t level) {
            return records_of(self, [&](const MapPackage& package) {
              return package.history(tile_id(x, y, level));
            });
          },
          py::arg("x"), py::arg("y"), py::kw_only(), py::arg("level") = 0)
      .def("_points", &points_in, py::arg("box"))
      .def("_objects", &objects_in, py::arg("box"))
      .def("trajectories",
           [](const MapHandle& self) {
             py::list all;
             for (const maps::Trajectory& trajectory : self.package->trajectories())
               all.append(trajectory_arrays(trajectory));
             return all;
           })
      .def(
          "verify", [](const MapHandle& self) { return self.package->verify(); },
          py::call_guard<py::gil_scoped_release>())
      .def("__repr__", [](const MapHandle& self) {
        return "<stillmap.Map " + self.package->folder().string() + ", digest " +
               self.package->digest().substr(0, 12) + ">";
      });
  module.def(
      "open_map_folder",
      [](const std::filesystem::path& folder) { return MapHandle{MapPackage::open(folder)}; },
      py::arg("folder"), py::call_guard<py::gil_scoped_release>());
}

}  // namespace stillmap::python
