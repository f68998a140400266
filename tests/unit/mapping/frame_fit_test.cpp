#include "registration/frame_fit.hpp"

#include <gtest/gtest.h>
#include <stillmap/maps/frames.hpp>

#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace frame_fit_test {

using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr FrameTolerance kTolerance{.translation_m = 0.3, .rotation_rad = 0.0175};

Eigen::Isometry3d truth() { return maps::exp_se3({12.0, -7.0, 0.4, 0.01, -0.02, 2.8}); }

/// Sights along a bend, far from the origin of their own frame, each wrong by its covariance.
std::vector<FrameSight> sights_of(std::size_t count, double sigma_m, double sigma_rad) {
  test::Random random(7);
  std::vector<FrameSight> sights;
  for (std::size_t i = 0; i < count; ++i) {
    const double s = static_cast<double>(i);
    FrameSight sight;
    sight.T_own_lidar = test::pose_at(5000.0 + 3.0 * s, -3000.0 + 0.1 * s * s, 0.05 * s);
    Vector6d error;
    for (Eigen::Index axis = 0; axis < 6; ++axis)
      error[axis] = (axis < 3 ? sigma_m : sigma_rad) * random.normal();
    sight.T_map_lidar = truth() * sight.T_own_lidar * maps::exp_se3(error);
    const double m2 = std::max(1e-6, sigma_m * sigma_m);
    const double rad2 = std::max(1e-8, sigma_rad * sigma_rad);
    sight.covariance.diagonal() << m2, m2, m2, rad2, rad2, rad2;
    sights.push_back(sight);
  }
  return sights;
}

/// How far two motions put the sights' places apart [m].
double apart(const FrameFit& fit, const std::vector<FrameSight>& sights) {
  double most = 0.0;
  for (const FrameSight& sight : sights) {
    const Eigen::Vector3d p = sight.T_own_lidar.translation();
    most = std::max(most, (fit.T_map_own * p - truth() * p).norm());
  }
  return most;
}

TEST(FrameFit, FindsTheMotionOfExactSights) {
  const std::vector<FrameSight> sights = sights_of(20, 0.0, 0.0);
  const Eigen::Isometry3d start = truth() * maps::exp_se3({0.0, 0.0, 0.0, 0.0, 0.0, 1e-4});
  const FrameFit fit = fit_frames(sights, start, kTolerance);
  EXPECT_LT(apart(fit, sights), 1e-6);
  EXPECT_EQ(fit.agreeing, 20U);
  EXPECT_LT(fit.residual_m, 1e-6);
  EXPECT_LT(fit.residual_rad, 1e-9);
}

TEST(FrameFit, AveragesWhatTheSightsAreWrongBy) {
  const std::vector<FrameSight> sights = sights_of(80, 0.03, 0.002);
  const FrameFit fit = fit_frames(sights, truth(), kTolerance);
  EXPECT_LT(apart(fit, sights), 0.02);
  EXPECT_NEAR(fit.residual_m, 0.03 * std::sqrt(3.0), 0.01);
  EXPECT_NEAR(fit.residual_rad, 0.002 * std::sqrt(3.0), 0.0007);
}

TEST(FrameFit, BelievesNoSightThatIsElsewhere) {
  std::vector<FrameSight> sights = sights_of(40, 0.01, 0.0005);
  for (std::size_t i = 0; i < sights.size(); i += 4)
    sights[i].T_map_lidar = sights[i].T_map_lidar * maps::exp_se3({1.5, 0.7, 0.0, 0.0, 0.0, 0.05});
  const FrameFit fit = fit_frames(sights, truth(), kTolerance);
  EXPECT_LT(apart(fit, sights), 0.01);
  EXPECT_EQ(fit.agreeing, 30U);
  EXPECT_EQ(fit.agrees[0], 0);
  EXPECT_EQ(fit.agrees[1], 1);
}

TEST(FrameFit, WeighsBySightsOwnCovariances) {
  std::vector<FrameSight> sights = sights_of(20, 0.0, 0.0);
  for (std::size_t i = 0; i < sights.size(); i += 2) {
    sights[i].T_map_lidar = sights[i].T_map_lidar * maps::exp_se3({0.2, 0.0, 0.0, 0.0, 0.0, 0.0});
    sights[i].covariance *= 1e4;
  }
  EXPECT_LT(apart(fit_frames(sights, truth(), kTolerance), sights), 0.02);
}

TEST(FrameFit, TheMotionOfMostSightsStartsIt) {
  std::vector<FrameSight> sights = sights_of(9, 0.05, 0.002);
  for (std::size_t i = 0; i < 4; ++i)
    sights[i].T_map_lidar = test::pose_at(50.0 * static_cast<double>(i), 0.0);
  const auto start = most_agreed(sights, {.translation_m = 1.0, .rotation_rad = 0.05}, 3);
  ASSERT_TRUE(start);
  EXPECT_LT((truth().inverse() * *start * sights[5].T_own_lidar.translation() -
             sights[5].T_own_lidar.translation())
                .norm(),
            1.0);
}

TEST(FrameFit, NoMotionStartsItWithoutAMajority) {
  std::vector<FrameSight> sights = sights_of(8, 0.0, 0.0);
  for (std::size_t i = 0; i < 4; ++i)
    sights[i].T_map_lidar = test::pose_at(50.0 * static_cast<double>(i), 0.0);
  const FrameTolerance tolerance{.translation_m = 1.0, .rotation_rad = 0.05};
  EXPECT_FALSE(most_agreed(sights, tolerance, 3)) << "four of eight are no majority";
  EXPECT_FALSE(most_agreed({}, tolerance, 3));
  EXPECT_FALSE(most_agreed(sights_of(2, 0.0, 0.0), tolerance, 3)) << "fewer than asked for";
}

}  // namespace frame_fit_test
}  // namespace stillmap::mapping
