#pragma once

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/scan.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace stillmap::python {

namespace py = pybind11;

inline constexpr auto kDouble = static_cast<py::ssize_t>(sizeof(double));

using Matrix6 = Eigen::Matrix<double, 6, 6>;

/// "float64 array with shape (3, 4)", or the type of what is no array.
[[nodiscard]] std::string description_of(py::handle value);

/// What every message about an argument looks like: "NAME: found FOUND, expected EXPECTED".
[[nodiscard]] py::value_error argument_error(const std::string& name, const std::string& found,
                                             const std::string& expected);

/// What a scan is made of. The arrays are copied; points without a return (not finite, or exactly
/// zero) are left out with their attributes and counted, as the readers of scans do.
/// @param points  N x 3 float32, any strides. @param times,intensities  N float32, or None.
/// @throws value_error naming the argument, what was found and what was expected.
[[nodiscard]] maps::Scan scan_of(py::handle points, py::handle times, py::handle intensities);

/// @throws value_error if it is no 4 x 4 matrix of finite numbers with the last row 0 0 0 1.
[[nodiscard]] Eigen::Isometry3d pose_of(const std::string& name, py::handle value);
/// @throws value_error if it is no 6 x 6 matrix.
[[nodiscard]] Matrix6 matrix6_of(const std::string& name, py::handle value);
/// Rows of x, y, z, length, width, height, yaw. @throws value_error if it is not K x 7.
[[nodiscard]] std::vector<maps::Box> boxes_of(const std::string& name, py::handle value);

/// (stamps, int64 with shape (N,); poses, float64 with shape (N, 4, 4)).
[[nodiscard]] py::tuple trajectory_arrays(const maps::Trajectory& trajectory);

/// Sizes as numpy has them.
[[nodiscard]] inline py::ssize_t signed_size(std::size_t size) {
  return static_cast<py::ssize_t>(size);
}

/// Memory of `owner` as a read-only array. The array keeps the owner alive.
template <typename Value>
[[nodiscard]] py::array view_of(const Value* values, std::vector<py::ssize_t> shape,
                                std::vector<py::ssize_t> strides, py::handle owner) {
  py::array view(py::dtype::of<Value>(), std::move(shape), std::move(strides), values, owner);
  view.attr("setflags")(py::arg("write") = false);
  return view;
}

/// The same of memory without gaps, row by row.
template <typename Value>
[[nodiscard]] py::array view_of(const Value* values, std::vector<py::ssize_t> shape,
                                py::handle owner) {
  std::vector<py::ssize_t> strides =
      py::detail::c_strides(shape, static_cast<py::ssize_t>(sizeof(Value)));
  return view_of(values, std::move(shape), std::move(strides), owner);
}

/// A vector as an array that owns it: nothing is copied, and it may be written to.
template <typename Value>
[[nodiscard]] py::array array_of(std::vector<Value> values, std::vector<py::ssize_t> shape) {
  auto kept = std::make_unique<std::vector<Value>>(std::move(values));
  const Value* data = kept->data();
  py::capsule owner(kept.get(),
                    [](void* vector) { delete static_cast<std::vector<Value>*>(vector); });
  static_cast<void>(kept.release());
  return py::array(py::dtype::of<Value>(), std::move(shape), data, owner);
}

}  // namespace stillmap::python
