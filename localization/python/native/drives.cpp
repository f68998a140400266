#include <stillmap/maps/drive.hpp>
#include <stillmap/maps/scan_file.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "arrays.hpp"
#include "bindings.hpp"

namespace stillmap::python {
namespace {

using maps::Drive;
using maps::Scan;
using Path = std::filesystem::path;

constexpr auto kMatrixBytes = static_cast<py::ssize_t>(sizeof(Eigen::Isometry3d));

/// Attribute of each point; None where the scan has none.
py::object floats_or_none(const std::vector<float>& values, py::handle owner) {
  if (values.empty()) return py::none();
  return view_of(values.data(), {signed_size(values.size())}, owner);
}

void bind_scan(py::module_& module) {
  py::class_<Scan, std::shared_ptr<Scan>>(module, "Scan", R"(One sweep of a lidar, in its frame.)")
      .def(py::init([](const py::object& points, const py::object& times,
                       const py::object& intensities, std::int64_t stamp_ns) {
             auto scan = std::make_shared<Scan>(scan_of(points, times, intensities));
             scan->stamp_ns = stamp_ns;
             return scan;
           }),
           py::arg("points"), py::arg("times") = py::none(), py::arg("intensities") = py::none(),
           py::kw_only(), py::arg("stamp_ns") = 0)
      .def_property_readonly("points",
                             [](const py::object& self) {
                               const auto& positions = self.cast<Scan&>().cloud.positions;
                               return view_of(positions.empty() ? nullptr : positions[0].data(),
                                              {signed_size(positions.size()), 3}, self);
                             })
      .def_property_readonly("times",
                             [](const py::object& self) {
                               return floats_or_none(self.cast<Scan&>().cloud.time_offsets_s, self);
                             })
      .def_property_readonly("intensities",
                             [](const py::object& self) {
                               return floats_or_none(self.cast<Scan&>().cloud.intensities, self);
                             })
      .def_readonly("stamp_ns", &Scan::stamp_ns)
      .def_readonly("index", &Scan::index)
      .def_readonly("source", &Scan::source)
      .def_readonly("points_in_file", &Scan::points_in_file)
      .def_readonly("times_note", &Scan::times_note)
      .def_property_readonly("dropped",
                             [](const Scan& scan) {
                               py::dict dropped;
                               dropped["non_finite"] = scan.dropped.non_finite;
                               dropped["zero_range"] = scan.dropped.zero_range;
                               dropped["unsure"] = scan.dropped.unsure;
                               return dropped;
                             })
      .def("__len__", [](const Scan& scan) { return scan.cloud.size(); })
      .def("__repr__", [](const Scan& scan) {
        return "<stillmap.Scan of " + std::to_string(scan.cloud.size()) + " points, stamp " +
               std::to_string(scan.stamp_ns) + " ns>";
      });
}

Drive open_drive(const Path& path, const std::optional<Path>& poses, double pose_time_offset_s) {
  if (!(std::abs(pose_time_offset_s) <= 1e9))
    throw argument_error("pose_time_offset_s", std::to_string(pose_time_offset_s),
                         "seconds in [-1e9, 1e9]");
  return Drive::open(path, poses, std::llround(1e9 * pose_time_offset_s));
}

std::shared_ptr<Scan> read_scan(const Drive& drive, py::ssize_t index) {
  const auto size = signed_size(drive.size());
  const py::ssize_t at = index < 0 ? index + size : index;
  if (at < 0 || at >= size)
    throw py::index_error("scan " + std::to_string(index) + " of a drive of " +
                          std::to_string(size));
  const py::gil_scoped_release release;
  return std::make_shared<Scan>(drive.read(static_cast<std::size_t>(at)));
}

void bind_drive(py::module_& module) {
  py::class_<Drive, std::shared_ptr<Drive>>(module, "Drive", R"(Scans in order, with poses.)")
      .def("__len__", &Drive::size)
      .def("read", &read_scan, py::arg("index"))
      .def("__getitem__", &read_scan, py::arg("index"))
      .def_property_readonly("stamps_ns",
                             [](const py::object& self) {
                               const auto& stamps = self.cast<Drive&>().contents().stamps_ns;
                               return view_of(stamps.data(), {signed_size(stamps.size())}, self);
                             })
      .def_property_readonly("poses",
                             [](const py::object& self) -> py::object {
                               const auto& poses = self.cast<Drive&>().contents().T_map_lidar;
                               if (poses.empty()) return py::none();
                               // Eigen's matrices lie column by column.
                               return view_of(poses[0].data(), {signed_size(poses.size()), 4, 4},
                                              {kMatrixBytes, kDouble, 4 * kDouble}, self);
                             })
      .def_property_readonly("path", [](const Drive& drive) { return drive.contents().root; })
      .def_property_readonly(
          "layout",
          [](const Drive& drive) { return std::string(name_of(drive.contents().layout)); })
      .def_property_readonly("notes", [](const Drive& drive) { return drive.contents().notes; })
      .def_property_readonly("relative_clock", &Drive::relative_clock)
      .def_property_readonly("geodetic_origin",
                             [](const Drive& drive) -> py::object {
                               const auto& origin = drive.contents().origin;
                               if (!origin) return py::none();
                               return py::make_tuple(origin->latitude_deg, origin->longitude_deg,
                                                     origin->altitude_m);
                             })
      .def("__repr__", [](const Drive& drive) {
        return "<stillmap.Drive of " + std::to_string(drive.size()) + " scans, " +
               std::string(name_of(drive.contents().layout)) + ">";
      });
  module.def("open_drive", &open_drive, py::arg("path"), py::arg("poses") = py::none(),
             py::kw_only(), py::arg("pose_time_offset_s") = 0.0,
             py::call_guard<py::gil_scoped_release>());
}

std::shared_ptr<Scan> read_scan_file(const Path& file, const std::string& bin_columns,
                                     std::optional<std::int64_t> stamp_ns) {
  maps::DecodedScan decoded =
      maps::read_scan_file(file, {.stamp_ns = stamp_ns, .bin_columns = bin_columns});
  auto scan = std::make_shared<Scan>();
  scan->stamp_ns = stamp_ns.value_or(0);
  scan->source = file.string();
  scan->cloud = std::move(decoded.cloud);
  scan->dropped = decoded.dropped;
  scan->points_in_file = decoded.points_in_file;
  scan->times_note = std::move(decoded.times_note);
  return scan;
}

void write_trajectory(const Path& file, const py::object& stamps_ns, const py::object& poses) {
  const auto stamps = py::array_t<std::int64_t, py::array::c_style>::ensure(stamps_ns);
  if (!stamps || stamps.ndim() != 1)
    throw argument_error("stamps_ns", description_of(stamps_ns), "an int64 array with shape (N,)");
  const auto given = py::reinterpret_borrow<py::object>(poses).cast<py::sequence>();
  if (signed_size(given.size()) != stamps.shape(0))
    throw argument_error(
        "poses", description_of(poses),
        "one 4 x 4 matrix for each of the " + std::to_string(stamps.shape(0)) + " stamps");
  std::vector<maps::StampedPose> stamped;
  for (py::ssize_t i = 0; i < stamps.shape(0); ++i)
    stamped.push_back({stamps.at(i), pose_of("poses[" + std::to_string(i) + "]",
                                             given[static_cast<std::size_t>(i)])});
  maps::write_tum_trajectory(file, maps::Trajectory(std::move(stamped)));
}

}  // namespace

void bind_drives(py::module_& module) {
  bind_scan(module);
  bind_drive(module);
  module.def("read_scan", &read_scan_file, py::arg("file"), py::kw_only(),
             py::arg("bin_columns") = "xyzi", py::arg("stamp_ns") = py::none(),
             py::call_guard<py::gil_scoped_release>());
  module.def(
      "read_trajectory",
      [](const Path& file) { return trajectory_arrays(maps::read_tum_trajectory(file)); },
      py::arg("file"));
  module.def("write_trajectory", &write_trajectory, py::arg("file"), py::arg("stamps_ns"),
             py::arg("poses"));
}

}  // namespace stillmap::python
