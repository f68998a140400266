#include <stillmap/localization/aligner.hpp>
#include <stillmap/localization/movable.hpp>
#include <stillmap/localization/options.hpp>
#include <stillmap/localization/tracker.hpp>

#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "bindings.hpp"
#include "map_handle.hpp"

namespace stillmap::python {
namespace {

using localization::AlignmentResult;
using localization::TrackedPose;

/// A method for a map, and the options that its sessions take.
struct Localizer {
  std::shared_ptr<const localization::Aligner> aligner;
  localization::TrackerOptions tracker;
};

/// One sequence: calls from several threads wait for each other.
class Session {
 public:
  explicit Session(const Localizer& localizer) : tracker_(localizer.aligner, localizer.tracker) {}

  void initialize(const Eigen::Isometry3d& T_map_lidar, const Matrix6& covariance) {
    const std::lock_guard lock(mutex_);
    tracker_.initialize(T_map_lidar, covariance);
  }
  TrackedPose track(std::int64_t stamp_ns, const maps::PointCloud& cloud,
                    const std::optional<localization::OdometryStep>& odometry) {
    const std::lock_guard lock(mutex_);
    return tracker_.track(stamp_ns, cloud, odometry);
  }

 private:
  std::mutex mutex_;
  localization::Tracker tracker_;
};

/// A scan that is asked for: borrowed where it is a Scan, else made of arrays.
class AskedScan {
 public:
  AskedScan(const py::object& points, const py::object& times, const py::object& movable) {
    if (py::isinstance<maps::Scan>(points)) {
      if (!times.is_none())
        throw argument_error("times", description_of(times),
                             "None beside a Scan, which has its own");
      kept_ = points.cast<std::shared_ptr<maps::Scan>>();
    } else {
      kept_ = std::make_shared<maps::Scan>(scan_of(points, times, py::none()));
    }
    if (!movable.is_none())
      without_ = localization::without_points_in(kept_->cloud, boxes_of("movable", movable));
  }
  [[nodiscard]] const maps::PointCloud& cloud() const {
    return without_ ? *without_ : kept_->cloud;
  }

 private:
  std::shared_ptr<const maps::Scan> kept_;
  std::optional<maps::PointCloud> without_;
};

localization::LocalizationOptions options_of(const std::string& preset,
                                             const std::map<std::string, double>& changes) {
  localization::LocalizationOptions options = localization::preset(preset);
  const auto all = localization::all_options();
  for (const auto& [key, value] : changes) {
    const auto found = std::find_if(all.begin(), all.end(),
                                    [&key = key](const auto& each) { return each.key == key; });
    if (found == all.end())
      throw argument_error("options", "'" + key + "'",
                           "names such as 'aligner.search_radius_m', see localization/options.md");
    if (found->whole && value != std::floor(value))
      throw argument_error("options['" + key + "']", std::to_string(value), "a whole number");
    found->set(options, value);
  }
  return options;
}

Localizer make_localizer(const MapHandle& map, const std::string& method, const std::string& preset,
                         const std::map<std::string, double>& changes) {
  const localization::LocalizationOptions options = options_of(preset, changes);
  return {localization::make_aligner(method, *map.package, options), options.tracker};
}

std::optional<localization::Prior> prior_of(const py::object& prior,
                                            const py::object& prior_covariance) {
  if (prior.is_none()) {
    if (prior_covariance.is_none()) return std::nullopt;
    throw argument_error("prior", "None beside prior_covariance",
                         "a 4 x 4 matrix; or leave out prior_covariance");
  }
  localization::Prior start{pose_of("prior", prior), std::nullopt};
  if (!prior_covariance.is_none())
    start.covariance = matrix6_of("prior_covariance", prior_covariance);
  return start;
}

AlignmentResult localize(const Localizer& self, const AskedScan& scan,
                         const std::optional<localization::Prior>& prior) {
  const py::gil_scoped_release release;
  return self.aligner->align(scan.cloud(), prior);
}

/// What `Session.track` is given first: the scan itself, or the stamp of one in arrays.
std::int64_t stamp_of(const py::object& stamp_or_scan, const py::object& points) {
  if (!py::isinstance<maps::Scan>(stamp_or_scan)) {
    if (PyIndex_Check(stamp_or_scan.ptr()) == 0)
      throw argument_error("stamp_ns", description_of(stamp_or_scan), "a whole number, or a Scan");
    return stamp_or_scan.cast<std::int64_t>();
  }
  if (!points.is_none())
    throw argument_error("points", description_of(points), "None beside a Scan, which has its own");
  return stamp_or_scan.cast<maps::Scan&>().stamp_ns;
}

TrackedPose track(Session& self, std::int64_t stamp_ns, const AskedScan& scan,
                  const std::optional<localization::OdometryStep>& odometry) {
  const py::gil_scoped_release release;
  return self.track(stamp_ns, scan.cloud(), odometry);
}

bool has_pose(const AlignmentResult& result) {
  return result.status != localization::PoseStatus::kLost;
}

/// Eigen's matrices lie column by column.
py::object matrix_or_none(const py::object& self, const double* data, py::ssize_t size) {
  if (!has_pose(self.cast<AlignmentResult&>())) return py::none();
  return view_of(data, {size, size}, {kDouble, size * kDouble}, self);
}

/// x, y, z, w with w >= 0, as the command line writes it.
py::object quaternion_of(const AlignmentResult& result) {
  if (!has_pose(result)) return py::none();
  Eigen::Quaterniond q(result.T_map_lidar.linear());
  if (q.w() < 0.0) q.coeffs() *= -1.0;
  return py::cast(Eigen::Vector4d(q.normalized().coeffs()));
}

/// A pose of numbers, as the command line reads it, to the bit.
py::array pose_matrix(const std::array<double, 3>& position,
                      const std::array<double, 4>& quaternion) {
  const Eigen::Vector3d t(position[0], position[1], position[2]);
  const Eigen::Quaterniond q(quaternion[3], quaternion[0], quaternion[1], quaternion[2]);
  if (!t.allFinite())
    throw argument_error("position", "a number that is not finite", "x, y, z [m]");
  constexpr double kNormTolerance = 1e-3;
  if (!(std::abs(q.norm() - 1.0) <= kNormTolerance))
    throw argument_error("quaternion", "norm " + std::to_string(q.norm()),
                         "x, y, z, w with norm 1 within 0.001");
  const Eigen::Matrix3d R = q.normalized().toRotationMatrix();
  std::vector<double> rows;
  for (Eigen::Index row = 0; row < 3; ++row)
    rows.insert(rows.end(), {R(row, 0), R(row, 1), R(row, 2), t(row)});
  rows.insert(rows.end(), {0.0, 0.0, 0.0, 1.0});
  return array_of(std::move(rows), {4, 4});
}

void bind_result(py::module_& module) {
  using Levels = localization::ProtectionLevels;
  py::class_<Levels>(module, "ProtectionLevels")
      .def_readonly("longitudinal_m", &Levels::longitudinal_m)
      .def_readonly("lateral_m", &Levels::lateral_m)
      .def_readonly("vertical_m", &Levels::vertical_m)
      .def_readonly("yaw_rad", &Levels::yaw_rad);
  py::class_<AlignmentResult>(module, "AlignmentResult")
      .def_property_readonly(
          "status", [](const AlignmentResult& r) { return std::string(name_of(r.status)); })
      .def_property_readonly("reasons",
                             [](const AlignmentResult& r) { return names_of(r.reasons); })
      .def_property_readonly("T_map_lidar",
                             [](const py::object& self) {
                               const auto& T = self.cast<AlignmentResult&>().T_map_lidar;
                               return matrix_or_none(self, T.data(), 4);
                             })
      .def_property_readonly("position",
                             [](const py::object& self) -> py::object {
                               const auto& result = self.cast<AlignmentResult&>();
                               if (!has_pose(result)) return py::none();
                               // The last column.
                               return view_of(result.T_map_lidar.data() + 12, {3}, self);
                             })
      .def_property_readonly("quaternion", &quaternion_of)
      .def_property_readonly("covariance",
                             [](const py::object& self) {
                               const auto& covariance = self.cast<AlignmentResult&>().covariance;
                               return matrix_or_none(self, covariance.data(), 6);
                             })
      .def_readonly("protection", &AlignmentResult::protection)
      .def(
          "protection_in_base",
          [](const AlignmentResult& r, const py::object& T_base_lidar) {
            return protection_levels_in_base(r, pose_of("T_base_lidar", T_base_lidar));
          },
          py::arg("T_base_lidar"))
      .def_readonly("inlier_ratio", &AlignmentResult::inlier_ratio)
      .def_readonly("rmse_m", &AlignmentResult::rmse_m)
      .def_readonly("iterations", &AlignmentResult::iterations)
      .def_property_readonly("degenerate_directions",
                             [](const py::object& self) {
                               const auto& all =
                                   self.cast<AlignmentResult&>().degenerate_directions;
                               return view_of(all.empty() ? nullptr : all[0].data(),
                                              {signed_size(all.size()), 6}, self);
                             })
      .def("__repr__", [](const AlignmentResult& r) {
        return "<stillmap.AlignmentResult " + std::string(name_of(r.status)) + ">";
      });
}

void bind_session(py::module_& module) {
  using localization::OdometryStep;
  py::class_<OdometryStep>(module, "OdometryStep")
      .def(py::init([](std::int64_t since_ns, const py::object& T_since_lidar,
                       const py::object& covariance) {
             return OdometryStep{since_ns, pose_of("T_since_lidar", T_since_lidar),
                                 matrix6_of("covariance", covariance)};
           }),
           py::arg("since_ns"), py::arg("T_since_lidar"), py::arg("covariance"))
      .def_readonly("since_ns", &OdometryStep::since_ns);
  py::class_<TrackedPose>(module, "TrackedPose")
      .def_readonly("stamp_ns", &TrackedPose::stamp_ns)
      .def_readonly("result", &TrackedPose::result)
      .def_property_readonly("searched_from", [](const TrackedPose& pose) {
        return std::string(name_of(pose.searched_from));
      });
  py::class_<Session>(module, "Session")
      .def(
          "initialize",
          [](Session& self, const py::object& T_map_lidar, const py::object& covariance) {
            const Eigen::Isometry3d T = pose_of("T_map_lidar", T_map_lidar);
            const Matrix6 matrix = matrix6_of("covariance", covariance);
            const py::gil_scoped_release release;
            self.initialize(T, matrix);
          },
          py::arg("T_map_lidar"), py::arg("covariance"))
      .def(
          "track",
          [](Session& self, const py::object& stamp_or_scan, const py::object& points,
             const py::object& times, const std::optional<localization::OdometryStep>& odometry,
             const py::object& movable) {
            const std::int64_t stamp_ns = stamp_of(stamp_or_scan, points);
            const bool is_scan = py::isinstance<maps::Scan>(stamp_or_scan);
            return track(self, stamp_ns,
                         AskedScan(is_scan ? stamp_or_scan : points, times, movable), odometry);
          },
          py::arg("stamp_ns"), py::arg("points") = py::none(), py::arg("times") = py::none(),
          py::kw_only(), py::arg("odometry") = py::none(), py::arg("movable") = py::none());
}

}  // namespace

void bind_localization(py::module_& module) {
  bind_result(module);
  bind_session(module);
  py::class_<Localizer>(module, "Localizer")
      .def(py::init(&make_localizer), py::arg("map"), py::kw_only(), py::arg("method") = "default",
           py::arg("preset") = "vehicle", py::arg("options") = std::map<std::string, double>{},
           py::call_guard<py::gil_scoped_release>())
      .def(
          "localize",
          [](const Localizer& self, const py::object& points, const py::object& times,
             const py::object& prior, const py::object& prior_covariance,
             const py::object& movable) {
            return localize(self, AskedScan(points, times, movable),
                            prior_of(prior, prior_covariance));
          },
          py::arg("points"), py::arg("times") = py::none(), py::kw_only(),
          py::arg("prior") = py::none(), py::arg("prior_covariance") = py::none(),
          py::arg("movable") = py::none())
      .def("session", [](const Localizer& self) { return std::make_unique<Session>(self); });
  module.def("methods", &localization::aligner_names);
  module.def("pose_matrix", &pose_matrix, py::arg("position"), py::arg("quaternion"));
}

}  // namespace stillmap::python
