#include <stillmap/mapping/deskew.hpp>
#include <stillmap/maps/frames.hpp>

#include <Eigen/Geometry>
#include <cmath>

namespace stillmap::mapping {
namespace {

/// Beyond this the speed between two neighbours says nothing about the speed during a sweep [s].
constexpr double kMaxNeighbourGapS = 2.0;

}  // namespace

std::optional<Eigen::Matrix<double, 6, 1>> twist_at(const maps::Drive& drive, std::size_t index) {
  if (!drive.has_poses() || drive.size() < 2 || index >= drive.size()) return std::nullopt;
  const auto gap_s = [&](std::size_t a, std::size_t b) {
    return 1e-9 * static_cast<double>(drive.stamp_ns(b) - drive.stamp_ns(a));
  };
  std::size_t before = index;
  std::size_t after = index;
  if (index > 0 && gap_s(index - 1, index) <= kMaxNeighbourGapS) before = index - 1;
  if (index + 1 < drive.size() && gap_s(index, index + 1) <= kMaxNeighbourGapS) after = index + 1;
  const double span_s = gap_s(before, after);
  if (!(span_s > 0.0)) return std::nullopt;
  // A constant twist is the same seen from any pose of its path, so this holds at `index` too.
  const Eigen::Isometry3d T_before_after =
      drive.T_map_lidar(before).inverse() * drive.T_map_lidar(after);
  return Eigen::Matrix<double, 6, 1>(maps::log_se3(T_before_after) / span_s);
}

void deskew(maps::PointCloud& cloud, const Eigen::Matrix<double, 6, 1>& twist_lidar) {
  if (cloud.time_offsets_s.empty()) return;
  const Eigen::Vector3d v = twist_lidar.head<3>();
  const double speed_rad_s = twist_lidar.tail<3>().norm();
  const bool turns = speed_rad_s > 1e-9;
  const Eigen::Vector3d axis =
      turns ? Eigen::Vector3d(twist_lidar.tail<3>() / speed_rad_s) : Eigen::Vector3d::Zero();
  // exp(twist t) p with the products that do not depend on t taken out of the loop.
  const Eigen::Vector3d axis_v = axis.cross(v);
  const Eigen::Vector3d axis_axis_v = axis.cross(axis_v);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double t = static_cast<double>(cloud.time_offsets_s[i]);
    Eigen::Vector3d p = cloud.positions[i].cast<double>() + v * t;
    if (turns) {
      const double sine = std::sin(speed_rad_s * t);
      const double one_minus_cosine = 1.0 - std::cos(speed_rad_s * t);
      const Eigen::Vector3d axis_p = axis.cross(cloud.positions[i].cast<double>());
      p += sine * axis_p + one_minus_cosine * axis.cross(axis_p) +
           (one_minus_cosine / speed_rad_s) * axis_v + (t - sine / speed_rad_s) * axis_axis_v;
    }
    cloud.positions[i] = p.cast<float>();
  }
}

}  // namespace stillmap::mapping
