#include "odometry/imu_clock.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/frames.hpp>

#include <cmath>

#include "support/matchers.hpp"

namespace stillmap::mapping {
namespace imu_clock_test {

using test::IsNearVector;

/// A hand that looks around.
Eigen::Matrix3d R_world_lidar(double time_s, double size = 1.0) {
  return Eigen::Matrix3d(
      Eigen::AngleAxisd(size * 0.4 * std::sin(2.0 * time_s), Eigen::Vector3d::UnitZ()) *
      Eigen::AngleAxisd(size * 0.1 * std::sin(3.1 * time_s + 1.0), Eigen::Vector3d::UnitY()) *
      Eigen::AngleAxisd(size * 0.1 * std::cos(2.6 * time_s), Eigen::Vector3d::UnitX()));
}

std::int64_t ns(double time_s) { return std::llround(1e9 * time_s); }

/// 200 Hz; the IMU's clock is behind by `late_s`.
std::vector<maps::ImuReading> gyroscope(double late_s, const Eigen::Vector3d& bias,
                                        double size = 1.0) {
  std::vector<maps::ImuReading> readings;
  for (int i = -400; i < 6400; ++i) {
    const double time_s = 0.005 * i;
    constexpr double kH = 1e-4;
    const Eigen::Vector3d rate = maps::log_so3(R_world_lidar(time_s - kH, size).transpose() *
                                               R_world_lidar(time_s + kH, size)) /
                                 (2.0 * kH);
    readings.push_back(
        {ns(time_s - late_s), (rate + bias).cast<float>(), Eigen::Vector3f(0.0F, 0.0F, 9.81F)});
  }
  return readings;
}

/// 10 Hz, half a minute; each turn is off by up to 2 mrad.
std::vector<ScanTurn> scans(double size = 1.0) {
  std::vector<ScanTurn> turns;
  for (int i = 0; i < 300; ++i) {
    const double from_s = 0.1 * i;
    const Eigen::Vector3d off(2e-3 * std::sin(17.0 * i), 2e-3 * std::sin(29.0 * i + 1.0),
                              2e-3 * std::sin(41.0 * i + 2.0));
    turns.push_back({ns(from_s), ns(from_s + 0.1),
                     R_world_lidar(from_s, size).transpose() * R_world_lidar(from_s + 0.1, size) *
                         maps::exp_so3(off)});
  }
  return turns;
}

TEST(ImuClock, FindsClockOffsetAndBias) {
  const Eigen::Vector3d bias(0.01, -0.015, 0.02);
  for (const double late_s : {0.0, 0.037, -0.21, 0.444}) {
    const auto check = fit_imu(scans(), gyroscope(late_s, bias));
    ASSERT_TRUE(check) << late_s;
    EXPECT_NEAR(1e-9 * static_cast<double>(check->fit.clock_offset_ns), late_s, 2e-3);
    EXPECT_THAT(check->fit.bias_radps, IsNearVector(bias, 2e-3));
    EXPECT_LT(check->off_rad, 0.004);
    EXPECT_GT(check->turn_rad, 0.02);
  }
}

TEST(ImuClock, WrongScansDoNotMoveIt) {
  std::vector<ScanTurn> turns = scans();
  for (std::size_t i = 0; i < turns.size(); i += 7)
    turns[i].R_from_to = maps::exp_so3(Eigen::Vector3d(0.5, 0.3, -1.0));
  const auto check = fit_imu(turns, gyroscope(0.1, Eigen::Vector3d(0.0, 0.0, 0.01)));
  ASSERT_TRUE(check);
  EXPECT_NEAR(1e-9 * static_cast<double>(check->fit.clock_offset_ns), 0.1, 3e-3);
  // They are on one side, and move the median by a few of the others.
  EXPECT_THAT(check->fit.bias_radps, IsNearVector(Eigen::Vector3d(0.0, 0.0, 0.01), 8e-3));
}

TEST(ImuClock, AStandingSensorTellsTheBiasAlone) {
  const Eigen::Vector3d bias(0.01, -0.015, 0.02);
  std::vector<ScanTurn> turns = scans(0.0);
  for (ScanTurn& turn : turns) turn.R_from_to.setIdentity();
  const auto check = fit_imu(turns, gyroscope(0.2, bias, 0.0));
  ASSERT_TRUE(check);
  EXPECT_EQ(check->fit.clock_offset_ns, 0);
  EXPECT_THAT(check->fit.bias_radps, IsNearVector(bias, 1e-6));
}

TEST(ImuClock, ReadingsOfOtherAxesOrAnotherTimeAreFarFromTheScans) {
  std::vector<maps::ImuReading> readings = gyroscope(0.0, Eigen::Vector3d::Zero());
  for (maps::ImuReading& reading : readings) reading.rate_radps *= -1.0F;
  const auto check = fit_imu(scans(), readings);
  ASSERT_TRUE(check);
  EXPECT_GT(check->off_rad, 0.5 * check->turn_rad);
  EXPECT_FALSE(fit_imu(scans(), gyroscope(1000.0, Eigen::Vector3d::Zero())));
  EXPECT_FALSE(fit_imu({}, readings));
}

}  // namespace imu_clock_test
}  // namespace stillmap::mapping
