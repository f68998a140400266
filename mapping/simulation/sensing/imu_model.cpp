#include "sensing/imu_model.hpp"

#include <fmt/format.h>

#include <cmath>
#include <iterator>

#include "geometry/random.hpp"

namespace stillmap::simulation {
namespace {

constexpr double kGravity = 9.81;
/// Step of the differences that rates are taken from [s].
constexpr double kH = 2e-3;
/// The same of accelerations: these are means over as much to each side, weighted by a triangle.
/// The sensor hangs in rubber: paths have jumps of some millimetres, which are no blows.
constexpr double kForceH = 0.02;
/// Readings before the first sweep and after the last [s].
constexpr double kMarginS = 0.2;

Eigen::Vector3d three_normals(Random& random) {
  const double x = random.normal();
  const double y = random.normal();
  return {x, y, random.normal()};
}

/// Offsets of a sensor's three axes, which walk.
struct Bias {
  Eigen::Vector3d now;
  /// Per root of a step.
  double walk;

  void step(Random& random) { now += walk * three_normals(random); }
};

}  // namespace

std::string imu_csv(const ImuModel& model,
                    const std::function<Eigen::Isometry3d(double)>& T_world_lidar,
                    const std::function<std::int64_t(double)>& stamp_ns, double end_s,
                    std::uint64_t key) {
  Random random(key);
  const double step_s = 1.0 / model.rate_hz;
  const double noise = std::sqrt(model.rate_hz);
  Bias gyro{model.gyro_offset_radps * three_normals(random), model.gyro_walk * std::sqrt(step_s)};
  Bias force{model.force_offset_mps2 * three_normals(random), model.force_walk * std::sqrt(step_s)};
  std::string csv = "stamp_ns,wx,wy,wz,ax,ay,az\n";
  const auto count = static_cast<long>(std::ceil((end_s + 2.0 * kMarginS) * model.rate_hz));
  for (long i = 0; i < count; ++i) {
    const double t = static_cast<double>(i) * step_s - kMarginS;
    const Eigen::Isometry3d before = T_world_lidar(t - kH);
    const Eigen::Isometry3d now = T_world_lidar(t);
    const Eigen::Isometry3d after = T_world_lidar(t + kH);
    const Eigen::AngleAxisd turn(before.linear().transpose() * after.linear());
    const Eigen::Vector3d acceleration =
        (T_world_lidar(t - kForceH) * model.lever_m - 2.0 * (now * model.lever_m) +
         T_world_lidar(t + kForceH) * model.lever_m) /
        (kForceH * kForceH);
    const Eigen::Vector3d rate = turn.angle() / (2.0 * kH) * turn.axis() + gyro.now +
                                 model.gyro_noise * noise * three_normals(random);
    Eigen::Vector3d specific =
        now.linear().transpose() * (acceleration + kGravity * Eigen::Vector3d::UnitZ()) +
        force.now + model.force_noise * noise * three_normals(random);
    specific = specific.cwiseMax(-model.most_force_mps2).cwiseMin(model.most_force_mps2);
    fmt::format_to(std::back_inserter(csv), "{},{:.7f},{:.7f},{:.7f},{:.6f},{:.6f},{:.6f}\n",
                   stamp_ns(t + model.clock_s), rate.x(), rate.y(), rate.z(), specific.x(),
                   specific.y(), specific.z());
    gyro.step(random);
    force.step(random);
  }
  return csv;
}

}  // namespace stillmap::simulation
