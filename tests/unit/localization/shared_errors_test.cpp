#include "align/shared_errors.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include <cmath>
#include <cstddef>
#include <numbers>
#include <random>

namespace stillmap::localization {
namespace shared_errors_test {

constexpr float kKernelM = 0.075F;
constexpr double kHalfM = 12.0;
constexpr double kTurnS = 0.1;
/// From here on a quarter of the view, with a corner of the hall.
constexpr double kBackLeft = 0.5 * std::numbers::pi;

/// Scans of the inside of a square hall with a floor, from its middle.
class Hall : public ::testing::Test {
 protected:
  /// Rows of a scan from the pose that fits best (the identity) but for what `shift` does to a
  /// point at an azimuth.
  /// @param from_rad  azimuth from which on the scan has points.
  /// @param thickness_m  of the map's surfaces.
  template <typename Shift>
  [[nodiscard]] ResidualRows rows(const Shift& shift, double from_rad = -std::numbers::pi,
                                  double thickness_m = 0.02) const {
    std::mt19937 random(1);
    std::normal_distribution<double> noise(0.0, 0.02);
    ResidualRows rows;
    rows.clear(Eigen::Vector3d::Zero());
    const auto variance = static_cast<float>(thickness_m * thickness_m);
    for (int i = -500; i < 500; ++i) {
      const double azimuth = std::numbers::pi * (i + 0.5) / 500.0;
      if (azimuth < from_rad) continue;
      const Eigen::Vector3d direction(std::cos(azimuth), std::sin(azimuth), 0.0);
      const double range_m = kHalfM / direction.cwiseAbs().maxCoeff();
      Eigen::Vector3d normal = Eigen::Vector3d::Zero();
      Eigen::Index axis = 0;
      direction.cwiseAbs().maxCoeff(&axis);
      normal[axis] = direction[axis] > 0.0 ? 1.0 : -1.0;
      for (const double height_m : {-1.0, 0.5, 2.0}) {
        const Eigen::Vector3d at = range_m * direction + Eigen::Vector3d(0.0, 0.0, height_m);
        add(rows, at + shift(azimuth, at) + noise(random) * normal, at, normal, variance);
      }
      const Eigen::Vector3d ground = 0.6 * range_m * direction - Eigen::Vector3d(0.0, 0.0, 1.7);
      add(rows, ground + noise(random) * Eigen::Vector3d::UnitZ(), ground, Eigen::Vector3d::UnitZ(),
          variance);
    }
    rows.pad();
    return rows;
  }
  [[nodiscard]] ResidualRows still(double from_rad = -std::numbers::pi,
                                   double thickness_m = 0.02) const {
    return rows([](double, const Eigen::Vector3d&) { return Eigen::Vector3d::Zero().eval(); },
                from_rad, thickness_m);
  }
  static void add(ResidualRows& rows, const Eigen::Vector3d& point, const Eigen::Vector3d& mean,
                  const Eigen::Vector3d& normal, float variance_m2) {
    rows.add(point.cast<float>(), normal.cast<float>(), static_cast<float>(normal.dot(mean)),
             variance_m2);
  }
  static double sigma_m(const ResidualRows& rows, MotionLeft left = MotionLeft::kPossible) {
    const Matrix6d covariance =
        covariance_of_shared_errors(rows, Eigen::Isometry3d::Identity(), kKernelM, left);
    return std::sqrt(covariance.topLeftCorner<2, 2>().trace());
  }
};

TEST_F(Hall, AScanOfAllDirectionsOfAMapWithExactPosesIsWorthMillimetres) {
  EXPECT_LT(sigma_m(still()), 0.004);
}

TEST_F(Hall, APartOfAScanDoesNotTellItsMotion) {
  EXPECT_GT(sigma_m(still(kBackLeft)), 2.0 * sigma_m(still()));
}

TEST_F(Hall, WhatTheMapDeskewedHasNoMotionLeft) {
  const ResidualRows part = still(kBackLeft);
  EXPECT_LT(sigma_m(part, MotionLeft::kNone), sigma_m(part, MotionLeft::kLittle));
  EXPECT_LT(sigma_m(part, MotionLeft::kLittle), sigma_m(part, MotionLeft::kPossible));
}

TEST_F(Hall, AThickMapIsWorthLessInAPartOfTheView) {
  const double thin = sigma_m(still(), MotionLeft::kNone);
  const double thick = sigma_m(still(-std::numbers::pi, 0.06), MotionLeft::kNone);
  const double part = sigma_m(still(kBackLeft, 0.06), MotionLeft::kNone);
  EXPECT_GT(thick, 3.0 * thin);
  EXPECT_GT(part, 1.4 * thick);
}

// The left half of the ranges is 5 cm long: the pose that fits best lies between what both say.
TEST_F(Hall, HalvesThatDisagreeCount) {
  const ResidualRows halves = rows([](double azimuth, const Eigen::Vector3d& at) {
    return Eigen::Vector3d((azimuth > 0.0 ? 0.025 : -0.025) * at.normalized());
  });
  EXPECT_GT(4.5 * sigma_m(halves, MotionLeft::kNone), 0.025);
}

// A turn of 6 deg/s that nobody took out: points lie where they were seen, seam behind.
TEST_F(Hall, ATurnThatWasLeftCounts) {
  constexpr double kTurnRad_S = 0.105;
  const ResidualRows turning = rows([](double azimuth, const Eigen::Vector3d& at) {
    const double angle = -kTurnRad_S * kTurnS * azimuth / (2.0 * std::numbers::pi);
    return Eigen::Vector3d(Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()) * at - at);
  });
  EXPECT_GT(sigma_m(turning), 2.0 * sigma_m(still()));
}

TEST_F(Hall, NoRowsTellNothing) {
  ResidualRows none;
  none.clear(Eigen::Vector3d::Zero());
  none.pad();
  EXPECT_TRUE(covariance_of_shared_errors(none, Eigen::Isometry3d::Identity(), kKernelM,
                                          MotionLeft::kPossible)
                  .isZero(0.0));
}

}  // namespace shared_errors_test
}  // namespace stillmap::localization
