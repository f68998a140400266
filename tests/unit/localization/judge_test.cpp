#include "align/judge.hpp"

#include <stillmap/localization/aligner.hpp>
#include <stillmap/maps/frames.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>

namespace stillmap::localization {
namespace verdict_test {

using test::pose_at;
using ::testing::Contains;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Not;

test::ScanPattern pattern(std::uint64_t seed) {
  test::ScanPattern out;
  out.noise_m = 0.02;
  out.seed = seed;
  return out;
}

std::vector<Eigen::Isometry3d> along_x(double from, double to) {
  std::vector<Eigen::Isometry3d> poses;
  for (double x = from; x <= to; x += 3.0) poses.push_back(pose_at(x, 0.0));
  return poses;
}

std::unique_ptr<Aligner> aligner_in(const test::SyntheticWorld& world, double from, double to) {
  return make_aligner("default",
                      MapIndex::build(world.mapped_from(along_x(from, to), pattern(50))));
}

struct Street {
  test::SyntheticWorld world = test::street(31);
  std::unique_ptr<Aligner> aligner = aligner_in(world, 15.0, 105.0);
};
const Street& street() {
  static const Street built;
  return built;
}

maps::PointCloud noise_scan(std::uint64_t seed) {
  test::Random random(seed);
  maps::PointCloud scan;
  for (int k = 0; k < 20'000; ++k) {
    scan.positions.push_back(
        Eigen::Vector3d(random.uniform(-40, 40), random.uniform(-40, 40), random.uniform(-2, 6))
            .cast<float>());
  }
  return scan;
}

TEST(Verdict, OkComesWithoutReasonsAndWithASmallCovariance) {
  const Eigen::Isometry3d T_map_lidar = pose_at(60.0, 0.5);
  const AlignmentResult result = street().aligner->align(
      street().world.scan(T_map_lidar, pattern(1)), Prior{T_map_lidar, std::nullopt});
  EXPECT_EQ(result.status, PoseStatus::kOk);
  EXPECT_THAT(result.reasons, IsEmpty());
  EXPECT_THAT(result.degenerate_directions, IsEmpty());
  EXPECT_TRUE(result.covariance == result.covariance.transpose().eval());
  EXPECT_GT(result.covariance.diagonal().minCoeff(), 0.0);
  EXPECT_LT(result.covariance.diagonal().head<3>().maxCoeff(), 0.1 * 0.1);
}

TEST(Verdict, ErrorsStayWithinTheCovariance) {
  std::size_t beyond = 0;
  constexpr std::size_t kScans = 20;
  for (std::size_t k = 0; k < kScans; ++k) {
    const Eigen::Isometry3d T_map_lidar = pose_at(40.0 + 2.0 * static_cast<double>(k), 0.4, 0.1);
    const AlignmentResult result = street().aligner->align(
        street().world.scan(T_map_lidar, pattern(200 + k)), Prior{T_map_lidar, std::nullopt});
    const Vector6d error = maps::log_se3(T_map_lidar.inverse() * result.T_map_lidar);
    if (error.dot(result.covariance.ldlt().solve(error)) > 12.59) ++beyond;  // 95 % point
  }
  EXPECT_LE(beyond, 2U);
}

TEST(Verdict, AWrongPlaceIsNeverOk) {
  for (const double away_m : {-40.0, -25.0, -12.0, 12.0, 20.0, 40.0}) {
    for (const double x : {50.0, 58.0, 66.0}) {
      const Eigen::Isometry3d T_map_lidar = pose_at(x, 0.5);
      Prior prior{T_map_lidar, std::nullopt};
      prior.T_map_lidar.translation().x() += away_m;
      const AlignmentResult result =
          street().aligner->align(street().world.scan(T_map_lidar, pattern(2)), prior);
      EXPECT_NE(result.status, PoseStatus::kOk) << away_m << " m from x = " << x;
      EXPECT_THAT(result.reasons, Not(IsEmpty()));
    }
  }
}

TEST(Verdict, AnotherStreetsMapIsLost) {
  const test::SyntheticWorld other = test::street(32);
  for (const double x : {45.0, 60.0, 75.0}) {
    const AlignmentResult result = street().aligner->align(other.scan(pose_at(x, 0.0), pattern(3)),
                                                           Prior{pose_at(x, 0.0), std::nullopt});
    EXPECT_NE(result.status, PoseStatus::kOk);
    EXPECT_THAT(result.reasons, Contains(Reason::kLowInlierRatio));
  }
}

TEST(Verdict, NoiseIsLost) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const AlignmentResult result =
        street().aligner->align(noise_scan(seed), Prior{pose_at(60.0, 0.0), std::nullopt});
    EXPECT_EQ(result.status, PoseStatus::kLost);
    EXPECT_THAT(result.reasons, ElementsAre(Reason::kLowInlierRatio));
  }
}

TEST(Verdict, EmptyTinyAndDuplicatedScansAreLostWithTheirPrior) {
  const Prior prior{pose_at(60.0, 0.0), std::nullopt};
  maps::PointCloud scan;
  for (const std::size_t count : {0U, 1U, 49U}) {
    scan.positions.assign(count, Eigen::Vector3f(5.0F, 1.0F, 0.0F));
    const AlignmentResult result = street().aligner->align(scan, prior);
    EXPECT_EQ(result.status, PoseStatus::kLost);
    EXPECT_THAT(result.reasons, ElementsAre(Reason::kTooFewPoints));
    EXPECT_TRUE(result.T_map_lidar.matrix() == prior.T_map_lidar.matrix());
  }
  scan.positions.assign(100'000, Eigen::Vector3f(5.0F, 1.0F, 0.0F));
  EXPECT_THAT(street().aligner->align(scan, prior).reasons, ElementsAre(Reason::kTooFewPoints));
  scan.positions.assign(100'000, Eigen::Vector3f(3e38F, 3e38F, -3e38F));
  EXPECT_THAT(street().aligner->align(scan, prior).reasons, ElementsAre(Reason::kTooFewPoints));
}

TEST(Verdict, APriorFarOutsideTheMapIsLost) {
  const maps::PointCloud scan = street().world.scan(pose_at(60.0, 0.0), pattern(4));
  for (const double x : {1e9, -1e9, 1e300, 400.0}) {
    const AlignmentResult result =
        street().aligner->align(scan, Prior{pose_at(x, 0.0), std::nullopt});
    EXPECT_EQ(result.status, PoseStatus::kLost);
    EXPECT_THAT(result.reasons, ElementsAre(Reason::kOutsideMap));
  }
}

TEST(Verdict, WhereTheMapHoldsNothingAScanIsLost) {
  // Within the margin around the map's bounds, yet far from all of its surfaces.
  const Prior prior{pose_at(60.0, 0.0, 0.0, 80.0), std::nullopt};
  const AlignmentResult result =
      street().aligner->align(street().world.scan(pose_at(60.0, 0.0), pattern(4)), prior);
  EXPECT_EQ(result.status, PoseStatus::kLost);
  EXPECT_THAT(result.reasons, ElementsAre(Reason::kLittleOverlap));
  EXPECT_TRUE(result.T_map_lidar.matrix() == prior.T_map_lidar.matrix());
}

TEST(Verdict, ACorridorDoesNotTellWhereAlongItOneIs) {
  const test::SyntheticWorld world = test::corridor();
  const auto aligner = aligner_in(world, -90.0, 90.0);
  const Eigen::Isometry3d T_map_lidar = pose_at(0.0, 0.5, 0.1);
  Prior prior{T_map_lidar, std::nullopt};
  prior.T_map_lidar.translation().x() += 1.0;
  const AlignmentResult result = aligner->align(world.scan(T_map_lidar, pattern(5)), prior);
  EXPECT_EQ(result.status, PoseStatus::kDegraded);
  EXPECT_THAT(result.reasons, Contains(Reason::kUnobservableDirection));
  ASSERT_FALSE(result.degenerate_directions.empty());
  Vector6d along = Vector6d::Zero();
  along.head<3>() = T_map_lidar.linear().transpose() * Eigen::Vector3d::UnitX();
  double agreement = 0.0;
  for (const Vector6d& direction : result.degenerate_directions) {
    EXPECT_NEAR(direction.norm(), 1.0, 1e-9);
    agreement += std::pow(direction.dot(along), 2);
  }
  EXPECT_GT(agreement, 0.95);
  EXPECT_GT(along.dot(result.covariance * along), 1.0);
  // Across the corridor and in heading it is as good as ever.
  const Eigen::Isometry3d difference = T_map_lidar.inverse() * result.T_map_lidar;
  EXPECT_LT(std::abs((T_map_lidar.linear() * difference.translation()).y()), 0.03);
  EXPECT_LT(maps::rotation_angle_rad(difference.linear()), 0.002);
}

TEST(Verdict, AnEmptyFieldIsNotOk) {
  const test::SyntheticWorld world = test::field();
  const auto aligner = aligner_in(world, -40.0, 40.0);
  const AlignmentResult result = aligner->align(world.scan(pose_at(0.0, 0.0), pattern(6)),
                                                Prior{pose_at(1.0, 0.0), std::nullopt});
  EXPECT_EQ(result.status, PoseStatus::kDegraded);
  EXPECT_THAT(result.reasons, Contains(Reason::kTooLittleStructure));
  EXPECT_THAT(result.reasons, Contains(Reason::kUnobservableDirection));
}

TEST(Verdict, APoseThatContradictsThePriorsCovarianceIsNotOk) {
  const Eigen::Isometry3d T_map_lidar = pose_at(60.0, 0.5);
  const maps::PointCloud scan = street().world.scan(T_map_lidar, pattern(7));
  Prior prior{T_map_lidar, Eigen::Matrix<double, 6, 6>(1e-2 * Matrix6d::Identity())};
  prior.T_map_lidar.translation().y() += 0.2;
  EXPECT_EQ(street().aligner->align(scan, prior).status, PoseStatus::kOk);
  prior.T_map_lidar.translation().y() += 1.3;
  const AlignmentResult result = street().aligner->align(scan, prior);
  EXPECT_EQ(result.status, PoseStatus::kDegraded);
  EXPECT_THAT(result.reasons, Contains(Reason::kContradictsPrior));
}

TEST(Verdict, TwoMillionPointsAreAnsweredLikeAnyScan) {
  const Eigen::Isometry3d T_map_lidar = pose_at(60.0, 0.5);
  const maps::PointCloud scan = street().world.scan(T_map_lidar, pattern(8));
  maps::PointCloud many;
  while (many.size() < 2'000'000) {
    many.positions.insert(many.positions.end(), scan.positions.begin(), scan.positions.end());
  }
  const AlignmentResult result = street().aligner->align(many, Prior{T_map_lidar, std::nullopt});
  EXPECT_EQ(result.status, PoseStatus::kOk);
}

TEST(ProtectionLevels, GrowWithEachAxisOwnDeviation) {
  Matrix6d covariance = Matrix6d::Identity() * 1e-4;
  covariance(1, 1) = 4e-4;
  covariance(5, 5) = 1e-6;
  const ProtectionLevels levels = protection_levels(covariance);
  EXPECT_NEAR(levels.lateral_m, 2.0 * levels.longitudinal_m, 1e-12);
  EXPECT_NEAR(levels.vertical_m, levels.longitudinal_m, 1e-12);
  EXPECT_NEAR(levels.yaw_rad, 0.1 * levels.longitudinal_m, 1e-12);
  EXPECT_GT(levels.longitudinal_m, 3.3 * 0.01);
}

TEST(ProtectionLevels, AreInfiniteWithoutACovariance) {
  const ProtectionLevels levels = protection_levels(Matrix6d::Zero());
  EXPECT_TRUE(std::isinf(levels.lateral_m) && std::isinf(levels.longitudinal_m) &&
              std::isinf(levels.vertical_m) && std::isinf(levels.yaw_rad));
}

TEST(Verdict, JudgeNamesEveryWeakness) {
  Evidence evidence;
  evidence.support = {0.9, 0.03, 500, 0.9, 0.9};
  const Matrix6d covariance = 1e-6 * Matrix6d::Identity();
  AlignmentResult result;
  judge(evidence, covariance, VerdictOptions{}, result);
  EXPECT_EQ(result.status, PoseStatus::kOk);
  evidence.support.standing_ratio = 0.5;
  evidence.support.known_ratio = 0.1;
  evidence.ambiguous = true;
  evidence.contradicts_prior = true;
  result = {};
  judge(evidence, Matrix6d::Identity(), VerdictOptions{}, result);
  EXPECT_EQ(result.status, PoseStatus::kDegraded);
  EXPECT_THAT(result.reasons,
              ElementsAre(Reason::kLowInlierRatio, Reason::kLittleOverlap, Reason::kAmbiguous,
                          Reason::kContradictsPrior, Reason::kLargeCovariance));
  evidence.support.standing_ratio = 0.2;
  result = {};
  judge(evidence, covariance, VerdictOptions{}, result);
  EXPECT_EQ(result.status, PoseStatus::kLost);
}

TEST(Verdict, OptionsMoveItsLimits) {
  Evidence evidence;
  evidence.support = {0.9, 0.03, 500, 0.9, 0.6};
  const Matrix6d covariance = 1e-2 * Matrix6d::Identity();
  VerdictOptions options;
  options.ok_support = 0.5;
  options.max_ok_deviation_m = 0.2;
  options.max_ok_deviation_rad = 0.2;
  AlignmentResult result;
  judge(evidence, covariance, options, result);
  EXPECT_EQ(result.status, PoseStatus::kOk);
  options.max_ok_deviation_m = 0.05;
  options.min_standing_points = 600;
  options.min_known_share = 0.95;
  result = {};
  judge(evidence, covariance, options, result);
  EXPECT_THAT(result.reasons, ElementsAre(Reason::kTooLittleStructure, Reason::kLittleOverlap,
                                          Reason::kLargeCovariance));
  options = {};
  options.lost_support = 0.7;
  result = {};
  judge(evidence, covariance, options, result);
  EXPECT_EQ(result.status, PoseStatus::kLost);
}

// --- where the world repeats itself --------------------------------------------------------------

/// Both walls of a cutting, with ribs a period apart along it.
test::SyntheticWorld ribbed(double period_m, double depth_m) {
  test::SyntheticWorld world;
  for (const double side : {-1.0, 1.0}) {
    const auto wall = [&](double x0, double x1, double near, double far) {
      world.boxes.push_back({{x0, std::min(side * near, side * far), 0.0},
                             {x1, std::max(side * near, side * far), 5.0}});
    };
    wall(-40.0, 160.0, 6.0, 7.0);
    for (double x = -40.0; x < 160.0; x += period_m)
      wall(x, x + 0.5 * period_m, 6.0 - depth_m, 6.0);
  }
  return world;
}

TEST(Verdict, APeriodOffIsNeverOk) {
  test::ScanPattern coarse = pattern(300);
  coarse.columns = 360;
  for (const double depth_m : {0.15, 0.3, 0.6}) {
    const test::SyntheticWorld world = ribbed(2.0, depth_m);
    const auto aligner = aligner_in(world, 20.0, 100.0);
    test::Random random(5);
    for (std::uint64_t k = 0; k < 16; ++k) {
      coarse.seed = 300 + k;
      const Eigen::Isometry3d T_map_lidar = pose_at(random.uniform(40.0, 80.0), 0.4);
      Prior prior{T_map_lidar, std::nullopt};
      prior.T_map_lidar.translation().x() += random.uniform(-2.0, 2.0);
      const AlignmentResult result = aligner->align(world.scan(T_map_lidar, coarse), prior);
      if (result.status != PoseStatus::kOk) continue;
      EXPECT_LT((result.T_map_lidar.translation() - T_map_lidar.translation()).norm(), 0.3)
          << depth_m << " " << k;
    }
  }
}

/// Two storeys, 3 m each, with the same walls and pillars.
test::SyntheticWorld two_storeys() {
  test::SyntheticWorld world;
  world.has_ground = false;
  for (const double z : {0.0, 3.0, 6.0}) {
    world.boxes.push_back({{-16.0, -11.0, z - 0.2}, {16.0, 11.0, z}});
  }
  world.boxes.push_back({{-16.0, -11.0, 0.0}, {-15.0, 11.0, 6.0}});
  world.boxes.push_back({{15.0, -11.0, 0.0}, {16.0, 11.0, 6.0}});
  world.boxes.push_back({{-16.0, -11.0, 0.0}, {16.0, -10.0, 6.0}});
  world.boxes.push_back({{-16.0, 10.0, 0.0}, {16.0, 11.0, 6.0}});
  for (const Eigen::Vector2d& at : {Eigen::Vector2d(4, 3), {-9, -5}, {-2, 7}, {9, -6}, {-8, 4}}) {
    world.boxes.push_back({{at.x(), at.y(), 0.0}, {at.x() + 1.0, at.y() + 0.6, 6.0}});
  }
  return world;
}

TEST(Verdict, TheOtherOfTwoEqualStoreysIsNeverOk) {
  const test::SyntheticWorld world = two_storeys();
  std::vector<Eigen::Isometry3d> poses;
  for (double x = -12.0; x <= 12.0; x += 3.0) {
    poses.push_back(pose_at(x, 0.5, 0.0, 1.2));
    poses.push_back(pose_at(x, 0.5, 0.0, 4.2));
  }
  test::ScanPattern indoors = pattern(50);
  indoors.lowest_rad = -0.6;
  indoors.highest_rad = 0.6;
  const auto aligner = make_aligner("default", MapIndex::build(world.mapped_from(poses, indoors)));
  int right = 0;
  for (std::uint64_t k = 0; k < 12; ++k) {
    indoors.seed = 400 + k;
    const Eigen::Isometry3d T_map_lidar =
        pose_at(-10.0 + 1.7 * static_cast<double>(k), 1.0, 0.3, k % 2 == 0 ? 1.2 : 4.2);
    const maps::PointCloud scan = world.scan(T_map_lidar, indoors);
    for (const double off_m : {-1.6, 1.6}) {
      Prior prior{T_map_lidar, std::nullopt};
      prior.T_map_lidar.translation().z() += off_m;
      const AlignmentResult result = aligner->align(scan, prior);
      const double error_m = (result.T_map_lidar.translation() - T_map_lidar.translation()).norm();
      if (result.status == PoseStatus::kOk) {
        EXPECT_LT(error_m, 0.3) << k << " " << off_m;
      }
    }
    Prior known{T_map_lidar, Matrix6d(0.01 * Matrix6d::Identity())};
    known.T_map_lidar.translation().z() += 0.2;
    const AlignmentResult result = aligner->align(scan, known);
    EXPECT_LT((result.T_map_lidar.translation() - T_map_lidar.translation()).norm(), 0.05) << k;
    if (result.status == PoseStatus::kOk) ++right;
  }
  EXPECT_EQ(right, 12);
}

TEST(Verdict, AScanWithinTheWallsOfASmallRoomIsOk) {
  test::SyntheticWorld world;
  world.has_ground = false;
  world.boxes = {{{-3, -3, -0.2}, {3, 3, 0}},  {{-3, -3, 2.6}, {3, 3, 2.8}},
                 {{-3, -3, 0}, {-2, 3, 2.6}},  {{2, -3, 0}, {3, 3, 2.6}},
                 {{-3, -3, 0}, {3, -2, 2.6}},  {{-3, 2, 0}, {3, 3, 2.6}},
                 {{-2, 0.5, 0}, {-1.4, 2, 2}}, {{0.6, 1.5, 0}, {1.8, 2, 0.8}}};
  test::ScanPattern indoors = pattern(50);
  indoors.lowest_rad = -0.6;
  indoors.highest_rad = 0.6;
  indoors.noise_m = 0.01;
  const auto aligner = make_aligner(
      "default",
      MapIndex::build(world.mapped_from(
          {pose_at(0, 0, 0, 1.2), pose_at(0.5, -0.5, 1, 1.2), pose_at(-0.6, -0.8, 2, 1.2)}, indoors,
          0.05)));
  for (std::uint64_t k = 0; k < 5; ++k) {
    indoors.seed = 500 + k;
    const Eigen::Isometry3d T_map_lidar = pose_at(0.2 * static_cast<double>(k), -0.3, 0.7, 1.2);
    const AlignmentResult result =
        aligner->align(world.scan(T_map_lidar, indoors), Prior{T_map_lidar, std::nullopt});
    EXPECT_THAT(result.reasons, IsEmpty()) << k;
    EXPECT_LT((result.T_map_lidar.translation() - T_map_lidar.translation()).norm(), 0.03) << k;
  }
}

}  // namespace verdict_test
}  // namespace stillmap::localization
