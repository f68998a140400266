#include <stillmap/maps/deskew.hpp>
#include <stillmap/maps/imu.hpp>

#include <Eigen/Geometry>

#include <cmath>

namespace stillmap::maps {
namespace {

struct SineAndVersine {
  double sine;
  /// 1 less the cosine.
  double versine;
};

/// By their series where angles are as small as a sensor turns within a scan; the first term left
/// out is below 3e-17. The library's functions were a third of deskewing.
SineAndVersine sine_and_versine(double angle_rad) {
  constexpr double kSmallRad = 0.15;
  if (!(std::abs(angle_rad) < kSmallRad)) return {std::sin(angle_rad), 1.0 - std::cos(angle_rad)};
  const double x2 = angle_rad * angle_rad;
  const double sine =
      angle_rad * (1.0 - x2 / 6.0 * (1.0 - x2 / 20.0 * (1.0 - x2 / 42.0 * (1.0 - x2 / 72.0))));
  const double versine =
      x2 / 2.0 * (1.0 - x2 / 12.0 * (1.0 - x2 / 30.0 * (1.0 - x2 / 56.0 * (1.0 - x2 / 90.0))));
  return {sine, versine};
}

}  // namespace

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
  const double seconds_a_rad = turns ? 1.0 / speed_rad_s : 0.0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double t = static_cast<double>(cloud.time_offsets_s[i]);
    Eigen::Vector3d p = cloud.positions[i].cast<double>() + v * t;
    if (turns) {
      const auto [sine, versine] = sine_and_versine(speed_rad_s * t);
      const Eigen::Vector3d axis_p = axis.cross(cloud.positions[i].cast<double>());
      p += sine * axis_p + versine * axis.cross(axis_p) + (versine * seconds_a_rad) * axis_v +
           (t - sine * seconds_a_rad) * axis_axis_v;
    }
    cloud.positions[i] = p.cast<float>();
    cloud.time_offsets_s[i] = 0.0F;
  }
}

}  // namespace stillmap::maps
