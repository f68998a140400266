#include "align/input_checks.hpp"
#include "align/registration.hpp"

#include <stillmap/localization/aligner.hpp>
#include <stillmap/maps/frames.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>

#include <limits>
#include <stdexcept>

namespace stillmap::localization {
namespace aligner_test {

using test::pose_at;
using ::testing::HasSubstr;

test::ScanPattern pattern(std::uint64_t seed) {
  test::ScanPattern out;
  out.noise_m = 0.02;
  out.seed = seed;
  return out;
}

std::vector<Eigen::Isometry3d> drive_through() {
  std::vector<Eigen::Isometry3d> poses;
  for (double x = 30.0; x <= 90.0; x += 3.0) poses.push_back(pose_at(x, 0.5 * std::sin(x), 0.02));
  return poses;
}

/// Built once: a street, its map and an aligner.
struct Street {
  test::SyntheticWorld world = test::street(21);
  std::vector<Eigen::Vector3d> points_map = world.mapped_from(drive_through(), pattern(100));
  std::unique_ptr<Aligner> aligner = make_aligner("default", MapIndex::build(points_map));
};
const Street& street() {
  static const Street built;
  return built;
}

Eigen::Isometry3d prior_off(const Eigen::Isometry3d& T, double metres, double degrees) {
  Eigen::Isometry3d prior = T;
  prior.translation() += metres * Eigen::Vector3d(0.8, -0.6, 0.1);
  const double yaw = degrees * std::numbers::pi / 180.0;
  prior.linear() = prior.linear() * (Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
                                     Eigen::AngleAxisd(-0.1 * yaw, Eigen::Vector3d::UnitY()))
                                        .toRotationMatrix();
  return prior;
}

double distance_m(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return (a.inverse() * b).translation().norm();
}
double angle_rad(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return maps::rotation_angle_rad((a.inverse() * b).linear());
}

TEST(Aligner, FindsTheScanFromPriorsOfUpTo2mAnd10Degrees) {
  for (const auto& [metres, degrees] :
       std::vector<std::pair<double, double>>{{0.0, 0.0}, {0.3, 2.0}, {1.0, -5.0}, {2.0, 10.0}}) {
    for (const double x : {45.0, 61.0, 77.0}) {
      const Eigen::Isometry3d T_map_lidar = pose_at(x, 0.8, 0.15);
      const AlignmentResult result =
          street().aligner->align(street().world.scan(T_map_lidar, pattern(7)),
                                  Prior{prior_off(T_map_lidar, metres, degrees), std::nullopt});
      EXPECT_EQ(result.status, PoseStatus::kOk) << metres << " m at x = " << x;
      EXPECT_LT(distance_m(T_map_lidar, result.T_map_lidar), 0.03) << metres << " m at x = " << x;
      EXPECT_LT(angle_rad(T_map_lidar, result.T_map_lidar), 0.001) << metres << " m at x = " << x;
      EXPECT_GT(result.inlier_ratio, 0.8);
      EXPECT_LT(result.rmse_m, 0.05);
      EXPECT_GT(result.iterations, 0);
    }
  }
}

TEST(Aligner, AnswerFollowsAMapThatIsMovedAndTurned) {
  const Eigen::Isometry3d T_map_lidar = pose_at(60.0, -0.5, 0.1);
  const maps::PointCloud scan = street().world.scan(T_map_lidar, pattern(8));
  Eigen::Isometry3d T_new_map = Eigen::Isometry3d::Identity();
  T_new_map.translation() = Eigen::Vector3d(431'000.3, -5'400'000.7, 210.1);
  T_new_map.linear() = Eigen::AngleAxisd(0.6, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  std::vector<Eigen::Vector3d> points_new = street().points_map;
  for (Eigen::Vector3d& p : points_new) p = T_new_map * p;
  const Prior prior{prior_off(T_map_lidar, 1.0, 5.0), std::nullopt};
  const Eigen::Isometry3d before = street().aligner->align(scan, prior).T_map_lidar;
  const AlignmentResult after =
      make_aligner("default", MapIndex::build(points_new))
          ->align(scan, Prior{T_new_map * prior.T_map_lidar, std::nullopt});
  EXPECT_EQ(after.status, PoseStatus::kOk);
  // The voxels lie elsewhere on the surfaces, so the answers agree within the noise, not to the
  // bit.
  EXPECT_LT(distance_m(T_new_map * before, after.T_map_lidar), 0.03);
  EXPECT_LT(angle_rad(T_new_map * before, after.T_map_lidar), 0.001);
}

TEST(Aligner, AnswerFollowsAScanThatIsTurnedInItsOwnFrame) {
  const Eigen::Isometry3d T_map_lidar = pose_at(60.0, 0.0);
  maps::PointCloud scan = street().world.scan(T_map_lidar, pattern(9));
  const Eigen::Isometry3d T_lidar_other = pose_at(0.4, -0.2, 2.0, 0.1);
  for (Eigen::Vector3f& p : scan.positions)
    p = (T_lidar_other.inverse() * p.cast<double>()).cast<float>();
  const AlignmentResult result = street().aligner->align(
      scan, Prior{prior_off(T_map_lidar * T_lidar_other, 1.0, 5.0), std::nullopt});
  EXPECT_EQ(result.status, PoseStatus::kOk);
  EXPECT_LT(distance_m(T_map_lidar * T_lidar_other, result.T_map_lidar), 0.03);
}

TEST(Aligner, SameInputGivesTheSameBits) {
  const Eigen::Isometry3d T_map_lidar = pose_at(55.0, 0.0);
  const maps::PointCloud scan = street().world.scan(T_map_lidar, pattern(10));
  const Prior prior{prior_off(T_map_lidar, 1.0, 5.0), std::nullopt};
  const AlignmentResult a = street().aligner->align(scan, prior);
  const AlignmentResult b = street().aligner->align(scan, prior);
  EXPECT_TRUE(a.T_map_lidar.matrix() == b.T_map_lidar.matrix());
  EXPECT_TRUE(a.covariance == b.covariance);
  EXPECT_EQ(a.iterations, b.iterations);
}

TEST(Aligner, AnswerIsARotation) {
  const Eigen::Isometry3d T_map_lidar = pose_at(55.0, 0.0);
  const AlignmentResult result =
      street().aligner->align(street().world.scan(T_map_lidar, pattern(11)),
                              Prior{prior_off(T_map_lidar, 2.0, 10.0), std::nullopt});
  const Eigen::Matrix3d R = result.T_map_lidar.linear();
  EXPECT_LT((R.transpose() * R - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(Aligner, RefusesNumbersThatAreNotFiniteAndRotationsThatAreNone) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  maps::PointCloud scan = street().world.scan(pose_at(55.0, 0.0), pattern(12));
  Prior prior{pose_at(55.0, 0.0), std::nullopt};
  prior.T_map_lidar.translation().x() = nan;
  EXPECT_THROW((void)street().aligner->align(scan, prior), std::invalid_argument);
  prior.T_map_lidar = pose_at(55.0, 0.0);
  prior.T_map_lidar.linear() *= 1.1;
  EXPECT_THROW((void)street().aligner->align(scan, prior), std::invalid_argument);
  prior.T_map_lidar = pose_at(55.0, 0.0);
  prior.covariance = -Eigen::Matrix<double, 6, 6>::Identity();
  EXPECT_THROW((void)street().aligner->align(scan, prior), std::invalid_argument);
  prior.covariance.reset();
  scan.positions[100].y() = std::numeric_limits<float>::infinity();
  EXPECT_THROW((void)street().aligner->align(scan, prior), std::invalid_argument);
}

TEST(Aligner, UnknownMethodAndMissingIndexAreNamed) {
  EXPECT_THAT([] { (void)make_aligner("fancy", nullptr); },
              ::testing::ThrowsMessage<std::invalid_argument>(
                  HasSubstr("'fancy', expected one of: default")));
  EXPECT_THROW((void)make_aligner("default", nullptr), std::invalid_argument);
  EXPECT_EQ(aligner_names().front(), "default");
}

TEST(Contradicts, APoseBeyondBothCovariancesAndACovarianceThatIsNoNumber) {
  Prior prior{pose_at(0.0, 0.0), std::nullopt};
  AlignmentResult result;
  result.T_map_lidar = pose_at(1.0, 0.0);
  result.covariance = 0.01 * Matrix6d::Identity();
  EXPECT_FALSE(contradicts(prior, result));
  // One metre is 22.4 or 22.5 in squares of their deviation.
  prior.covariance = Matrix6d((1.0 / 22.4 - 0.01) * Matrix6d::Identity());
  EXPECT_FALSE(contradicts(prior, result));
  prior.covariance = Matrix6d((1.0 / 22.5 - 0.01) * Matrix6d::Identity());
  EXPECT_TRUE(contradicts(prior, result));
  prior.covariance = Matrix6d(Matrix6d::Identity());
  result.covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_TRUE(contradicts(prior, result));
}

}  // namespace aligner_test
}  // namespace stillmap::localization
