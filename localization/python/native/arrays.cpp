#include "arrays.hpp"

#include <pybind11/eigen.h>

#include <cstdint>
#include <cstring>

namespace stillmap::python {
namespace {

/// One float32 of an array with any strides, aligned or not.
float float_at(const std::byte* at) {
  float value = 0.0F;
  std::memcpy(&value, at, sizeof value);
  return value;
}

bool is_float32(py::handle value) { return py::isinstance<py::array_t<float, 0>>(value); }

std::vector<float> floats_of(const std::string& name, py::handle value, py::ssize_t size) {
  if (value.is_none()) return {};
  const std::string expected =
      "a float32 array with shape (" + std::to_string(size) + ",), one number for each point";
  if (!is_float32(value)) throw argument_error(name, description_of(value), expected);
  const auto array = py::reinterpret_borrow<py::array>(value);
  if (array.ndim() != 1 || array.shape(0) != size)
    throw argument_error(name, description_of(value), expected);
  const auto* const data = static_cast<const std::byte*>(array.data());
  std::vector<float> values(static_cast<std::size_t>(size));
  for (py::ssize_t i = 0; i < size; ++i)
    values[static_cast<std::size_t>(i)] = float_at(data + i * array.strides(0));
  return values;
}

std::vector<Eigen::Vector3f> positions_of(py::handle value) {
  const std::string expected = "a float32 array with shape (N, 3)";
  if (!is_float32(value)) {
    const bool is_array = py::isinstance<py::array>(value);
    throw argument_error(
        "points", description_of(value),
        expected + (is_array ? ": convert it with .astype(numpy.float32)" : ", or a Scan"));
  }
  const auto array = py::reinterpret_borrow<py::array>(value);
  if (array.ndim() != 2 || array.shape(1) != 3) {
    const bool wider = array.ndim() == 2 && array.shape(1) > 3;
    throw argument_error("points", description_of(value),
                         expected + (wider ? ": give the columns x y z, points[:, :3]" : ""));
  }
  const auto* const data = static_cast<const std::byte*>(array.data());
  std::vector<Eigen::Vector3f> positions(static_cast<std::size_t>(array.shape(0)));
  for (py::ssize_t i = 0; i < array.shape(0); ++i)
    for (py::ssize_t axis = 0; axis < 3; ++axis)
      positions[static_cast<std::size_t>(i)](axis) =
          float_at(data + i * array.strides(0) + axis * array.strides(1));
  return positions;
}

/// Any numbers as doubles, row by row. @throws value_error for another shape.
py::array_t<double, py::array::c_style | py::array::forcecast> doubles_of(
    const std::string& name, py::handle value, const std::string& expected) {
  auto array = py::array_t<double, py::array::c_style | py::array::forcecast>::ensure(value);
  if (!array) throw argument_error(name, description_of(value), expected);
  return array;
}

}  // namespace

std::string description_of(py::handle value) {
  if (!py::isinstance<py::array>(value))
    return value.is_none() ? "None" : py::str(py::type::of(value).attr("__name__"));
  return py::str(value.attr("dtype")).cast<std::string>() + " array with shape " +
         py::str(value.attr("shape")).cast<std::string>();
}

py::value_error argument_error(const std::string& name, const std::string& found,
                               const std::string& expected) {
  return py::value_error(name + ": found " + found + ", expected " + expected);
}

maps::Scan scan_of(py::handle points, py::handle times, py::handle intensities) {
  maps::Scan scan;
  scan.cloud.positions = positions_of(points);
  const auto size = static_cast<py::ssize_t>(scan.cloud.size());
  scan.cloud.time_offsets_s = floats_of("times", times, size);
  scan.cloud.intensities = floats_of("intensities", intensities, size);
  scan.points_in_file = scan.cloud.size();
  std::vector<std::uint8_t> keep(scan.cloud.size(), 1);
  for (std::size_t i = 0; i < keep.size(); ++i) {
    const Eigen::Vector3f& p = scan.cloud.positions[i];
    if (!p.allFinite()) {
      ++scan.dropped.non_finite;
      keep[i] = 0;
    } else if (p.isZero(0.0F)) {
      ++scan.dropped.zero_range;
      keep[i] = 0;
    }
  }
  scan.cloud.keep_only(keep);
  return scan;
}

Eigen::Isometry3d pose_of(const std::string& name, py::handle value) {
  const std::string expected = "a 4 x 4 matrix of a rotation and a translation";
  const auto array = doubles_of(name, value, expected);
  if (array.ndim() != 2 || array.shape(0) != 4 || array.shape(1) != 4)
    throw argument_error(name, description_of(array), expected);
  using RowMajor4 = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;
  const Eigen::Matrix4d matrix = Eigen::Map<const RowMajor4>(array.data());
  if (!matrix.allFinite()) throw argument_error(name, "a number that is not finite", expected);
  if (matrix.row(3) != Eigen::RowVector4d(0.0, 0.0, 0.0, 1.0))
    throw argument_error(name, "a last row other than 0 0 0 1", expected);
  Eigen::Isometry3d T;
  T.matrix() = matrix;
  return T;
}

Matrix6 matrix6_of(const std::string& name, py::handle value) {
  const std::string expected = "a 6 x 6 matrix, rows tx ty tz [m] rx ry rz [rad]";
  const auto array = doubles_of(name, value, expected);
  if (array.ndim() != 2 || array.shape(0) != 6 || array.shape(1) != 6)
    throw argument_error(name, description_of(array), expected);
  using RowMajor6 = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
  return Eigen::Map<const RowMajor6>(array.data());
}

std::vector<maps::Box> boxes_of(const std::string& name, py::handle value) {
  const std::string expected =
      "an array with shape (K, 7): x, y, z, length, width, height [m], yaw [rad] of each box";
  const auto array = doubles_of(name, value, expected);
  if (array.ndim() != 2 || array.shape(1) != 7)
    throw argument_error(name, description_of(array), expected);
  std::vector<maps::Box> boxes(static_cast<std::size_t>(array.shape(0)));
  const auto rows = array.unchecked<2>();
  for (py::ssize_t i = 0; i < array.shape(0); ++i) {
    maps::Box& box = boxes[static_cast<std::size_t>(i)];
    box.centre = {rows(i, 0), rows(i, 1), rows(i, 2)};
    box.size_m = {rows(i, 3), rows(i, 4), rows(i, 5)};
    box.yaw_rad = rows(i, 6);
  }
  return boxes;
}

py::tuple trajectory_arrays(const maps::Trajectory& trajectory) {
  std::vector<std::int64_t> stamps;
  std::vector<double> poses;
  stamps.reserve(trajectory.size());
  poses.reserve(16 * trajectory.size());
  for (const maps::StampedPose& pose : trajectory.poses()) {
    stamps.push_back(pose.stamp_ns);
    for (Eigen::Index row = 0; row < 4; ++row)
      for (Eigen::Index column = 0; column < 4; ++column)
        poses.push_back(pose.T_map_lidar.matrix()(row, column));
  }
  const py::ssize_t size = signed_size(stamps.size());
  return py::make_tuple(array_of(std::move(stamps), {size}),
                        array_of(std::move(poses), {size, 4, 4}));
}

}  // namespace stillmap::python
