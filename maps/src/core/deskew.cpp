#include <stillmap/maps/deskew.hpp>
#include <stillmap/maps/imu.hpp>

#include <Eigen/Geometry>

#include <cmath>

namespace stillmap::maps {

void deskew(PointCloud& cloud, const Eigen::Matrix<double, 6, 1>& twist_lidar) {
  if (cloud.time_offsets_s.empty()) return;
  turn_to_stamp(cloud);
  const Eigen::Vector3d v = twist_lidar.head<3>();
  const double speed_rad_s = cloud.turn ? 0.0 : twist_lidar.tail<3>().norm();
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
    cloud.time_offsets_s[i] = 0.0F;
  }
}

}  // namespace stillmap::maps
