#include "odometry/imu_clock.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/maps/frames.hpp>

#include <cmath>
#include <memory>
#include <string>

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
    EXPECT_GT(check->explained, 0.95);
    EXPECT_LT(check->offset_sigma_s, 2e-3);
    EXPECT_TRUE(check->offset_is_inside);
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

maps::Imu imu_of(std::vector<maps::ImuReading> readings, const char* source = "imu.csv") {
  maps::Imu imu;
  imu.source = source;
  imu.readings = std::make_shared<const std::vector<maps::ImuReading>>(std::move(readings));
  return imu;
}

std::string fault_of(const std::vector<ScanTurn>& turns, const maps::Imu& imu) {
  return imu_fault(imu, turns, fit_imu(turns, *imu.readings));
}

/// A car turns by some 0.2 deg a scan; a scan is off by up to 0.02 deg.
std::vector<ScanTurn> car_scans() {
  std::vector<ScanTurn> turns;
  for (int i = 0; i < 300; ++i) {
    const double from_s = 0.1 * i;
    const Eigen::Vector3d off = 2e-4 * Eigen::Vector3d(std::sin(17.0 * i), std::sin(29.0 * i + 1.0),
                                                       std::sin(41.0 * i + 2.0));
    turns.push_back({ns(from_s), ns(from_s + 0.1),
                     R_world_lidar(from_s, 0.1).transpose() * R_world_lidar(from_s + 0.1, 0.1) *
                         maps::exp_so3(off)});
  }
  return turns;
}

TEST(ImuClock, AnImuThatFitsHasNoFault) {
  const Eigen::Vector3d bias(0.01, -0.015, 0.02);
  EXPECT_EQ(fault_of(scans(), imu_of(gyroscope(0.037, bias))), "");
  EXPECT_EQ(fault_of(car_scans(), imu_of(gyroscope(0.037, bias, 0.1))), "");
}

TEST(ImuClock, AWrongGyroscopeDoesNotExplainTheTurnsOfACar) {
  const auto changed = [](const auto& change) {
    std::vector<maps::ImuReading> readings = gyroscope(0.037, Eigen::Vector3d::Zero(), 0.1);
    for (maps::ImuReading& reading : readings) reading.rate_radps = change(reading.rate_radps);
    return fault_of(car_scans(), imu_of(std::move(readings)));
  };
  using Rate = Eigen::Vector3f;
  const std::string dead = changed([](const Rate&) { return Rate(Rate::Zero()); });
  EXPECT_THAT(dead, testing::AllOf(testing::HasSubstr("it explains 0 % of the turns"),
                                   testing::HasSubstr("that the axes of imu.csv are the lidar's")));
  EXPECT_NE(changed([](const Rate& w) { return Rate(-w); }), "");
  EXPECT_NE(changed([](const Rate& w) { return Rate(w.z(), w.x(), w.y()); }), "");
  EXPECT_NE(changed([](const Rate& w) { return Rate(-w.x(), w.y(), -w.z()); }), "");
  EXPECT_THAT(changed([](const Rate& w) { return Rate(w * 57.29578F); }),
              testing::HasSubstr("deg/s, expected rad/s"));
  EXPECT_THAT(changed([](const Rate& w) { return Rate(w + Rate(0.0F, 0.2F, 0.0F)); }),
              testing::HasSubstr("off by 11.5 deg/s at rest"));
}

TEST(ImuClock, AClockThatIsFartherOffIsNotUsed) {
  const std::string fault = fault_of(scans(), imu_of(gyroscope(0.62, Eigen::Vector3d::Zero())));
  EXPECT_THAT(fault, testing::HasSubstr("differ by more than 0.5 s"));
}

TEST(ImuClock, WithoutTurnsNothingTellsWhetherItFits) {
  std::vector<ScanTurn> turns = scans(0.0);
  for (ScanTurn& turn : turns) turn.R_from_to.setIdentity();
  EXPECT_THAT(fault_of(turns, imu_of(gyroscope(0.2, Eigen::Vector3d::Zero(), 0.0))),
              testing::HasSubstr("does not turn"));
}

TEST(ImuClock, TurnsAtOneRateDoNotTellTheClock) {
  // It turns at a steady rate, then at another one: only the change between tells the clock.
  const auto R = [](double t) {
    return maps::exp_so3(Eigen::Vector3d(0.0, 0.0, t < 15.0 ? 0.0 : 0.2 * (t - 15.0)));
  };
  std::vector<ScanTurn> turns;
  for (int i = 0; i < 300; ++i)
    turns.push_back(
        {ns(0.1 * i), ns(0.1 * i + 0.1),
         R(0.1 * i).transpose() * R(0.1 * i + 0.1) *
             maps::exp_so3(8e-3 * Eigen::Vector3d(std::sin(17.0 * i), std::sin(29.0 * i), 0.0))});
  std::vector<maps::ImuReading> readings = gyroscope(0.0, Eigen::Vector3d::Zero(), 0.0);
  for (maps::ImuReading& reading : readings)
    if (reading.stamp_ns > ns(15.0)) reading.rate_radps.z() = 0.2F;
  EXPECT_THAT(fault_of(turns, imu_of(std::move(readings))),
              testing::HasSubstr("too little to measure its clock offset"));
}

TEST(ImuClock, TheFaultNamesWhatIsMissing) {
  const maps::Imu other_time = imu_of(gyroscope(1000.0, Eigen::Vector3d::Zero()));
  EXPECT_THAT(fault_of(scans(), other_time), testing::HasSubstr("no readings at the stamps"));
  EXPECT_THAT(fault_of({}, other_time), testing::HasSubstr("fewer than 21 scans"));
  std::vector<maps::ImuReading> readings = gyroscope(0.0, Eigen::Vector3d::Zero());
  for (maps::ImuReading& reading : readings) reading.rate_radps *= -1.0F;
  EXPECT_THAT(fault_of(scans(), imu_of(std::move(readings), "/imu/data")),
              testing::HasSubstr("mount of the IMU in tf_static"));
}

}  // namespace imu_clock_test
}  // namespace stillmap::mapping
