#include "evaluation/localization/prior_draws.hpp"

#include <cmath>
#include <numbers>

namespace stillmap::mapping {
namespace {

constexpr std::uint64_t kGolden = 0x9E3779B97F4A7C15ULL;

std::uint64_t mixed(std::uint64_t x) {
  x += kGolden;
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9ULL;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBULL;
  return x ^ (x >> 31);
}

}  // namespace

CounterRandom::CounterRandom(std::uint64_t seed, std::uint64_t scan, std::uint64_t trial)
    : key_(mixed(mixed(mixed(seed) ^ scan) ^ trial)) {}

double CounterRandom::uniform(std::uint64_t draw) const {
  return static_cast<double>(mixed(key_ ^ mixed(draw)) >> 11) * 0x1p-53;
}

Eigen::Isometry3d with_prior_error(const Eigen::Isometry3d& T_map_lidar, const PriorError& error,
                                   const CounterRandom& random) {
  constexpr double kPartOfOtherAxes = 0.1;
  const double direction = 2.0 * std::numbers::pi * random.uniform(0);
  const double yaw = error.degrees * std::numbers::pi / 180.0;
  const double tilt = kPartOfOtherAxes * yaw;
  Eigen::Isometry3d T = T_map_lidar;
  T.translation() += error.metres * Eigen::Vector3d(std::cos(direction), std::sin(direction),
                                                    kPartOfOtherAxes * random.sign(1));
  const Eigen::Quaterniond turn =
      Eigen::AngleAxisd(random.sign(2) * yaw, Eigen::Vector3d::UnitZ()) *
      Eigen::AngleAxisd(random.sign(3) * tilt, Eigen::Vector3d::UnitY()) *
      Eigen::AngleAxisd(random.sign(4) * tilt, Eigen::Vector3d::UnitX());
  T.linear() = T_map_lidar.linear() * turn.toRotationMatrix();
  return T;
}

}  // namespace stillmap::mapping
