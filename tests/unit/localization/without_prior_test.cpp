#include "align/place_search.hpp"
#include "align/pose_search.hpp"
#include "index/index_window.hpp"
#include "index/place_rows.hpp"

#include <stillmap/localization/aligner.hpp>

#include <stillmap/maps/frames.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>

#include <algorithm>
#include <limits>
#include <numbers>
#include <optional>
#include <stdexcept>

namespace stillmap::localization {
namespace without_prior_test {

using test::pose_at;

test::ScanPattern pattern(std::uint64_t seed) {
  test::ScanPattern out;
  out.noise_m = 0.02;
  out.seed = seed;
  return out;
}

std::vector<Eigen::Isometry3d> drive_through() {
  std::vector<Eigen::Isometry3d> poses;
  for (double x = 20.0; x <= 110.0; x += 3.0) poses.push_back(pose_at(x, 0.5 * std::sin(x), 0.02));
  return poses;
}

struct Street {
  test::SyntheticWorld world = test::street(21);
  std::vector<Eigen::Vector3d> points_map = world.mapped_from(drive_through(), pattern(100));
  std::shared_ptr<const MapIndex> index = MapIndex::build(points_map);
  std::unique_ptr<Aligner> aligner = make_aligner("default", index, drive_through());
};
const Street& street() {
  static const Street built;
  return built;
}

TEST(WithoutPrior, FindsTheScanInEveryHeading) {
  for (const double x : {25.0, 61.5, 104.0}) {
    for (double yaw = -3.0; yaw < 3.1; yaw += 1.1) {
      const Eigen::Isometry3d T = pose_at(x, -0.7, yaw);
      const AlignmentResult result =
          street().aligner->align(street().world.scan(T, pattern(7)), std::nullopt);
      EXPECT_NE(result.status, PoseStatus::kLost);
      const Eigen::Isometry3d difference = T.inverse() * result.T_map_lidar;
      EXPECT_LT(difference.translation().norm(), 0.1) << x << " " << yaw;
      EXPECT_LT(maps::rotation_angle_rad(difference.linear()), 0.01) << x << " " << yaw;
    }
  }
}

TEST(PlaceSearch, AnswersWithARotationAlsoWhereTheSensorLooksAlongTheMapsX) {
  Eigen::Isometry3d T_map_lidar = pose_at(60.0, 0.0);
  T_map_lidar.linear() << 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 0.0;
  // The others are upright, so it is no tilted mount, and too far off to be places of the map.
  std::vector<Eigen::Isometry3d> seen_from(9, pose_at(1e4, 0.0));
  seen_from.push_back(T_map_lidar);
  const MapIndex& index = *street().index;
  const PlaceSearch places(index, places_of(seen_from, index.origin(), index.bounds()));
  Query query;
  query.points = {{5.0F, 0.0F, 1.0F}, {0.0F, 5.0F, 1.0F}};
  query.stands = {1, 1};
  query.standing = {0, 1};
  const std::vector<Eigen::Isometry3d> found = places.best_places(query, 1, {});
  ASSERT_FALSE(found.empty());
  const Eigen::Matrix3d R = found.front().linear();
  EXPECT_LT((R.transpose() * R - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff(), 1e-5);
  EXPECT_LT((R.col(2) - Eigen::Vector3d::UnitX()).norm(), 1e-5);
}

TEST(PlaceSearch, LooksOnlyIntoTheHeadingsOfTheRegion) {
  const MapIndex& index = *street().index;
  const PlaceSearch places(index, places_of(drive_through(), index.origin(), index.bounds()));
  Query query;
  query.points = {{5.0F, 0.0F, 1.0F}, {0.0F, 5.0F, 1.0F}};
  query.stands = {1, 1};
  query.standing = {0, 1};
  for (const double yaw_rad : {-2.0, 1.0, 2.5}) {
    PlaceSearch::Region region;
    region.yaw_rad = yaw_rad;
    region.yaw_window_rad = 0.3;
    const std::vector<Eigen::Isometry3d> found = places.best_places(query, 20, region);
    ASSERT_FALSE(found.empty());
    for (const Eigen::Isometry3d& T : found) {
      const double heading_rad = std::atan2(T.linear()(1, 0), T.linear()(0, 0));
      // The window, half a heading, and the turns of the two later rounds.
      EXPECT_LT(std::abs(std::remainder(heading_rad - yaw_rad, 2.0 * std::numbers::pi)), 0.5);
    }
  }
}

TEST(PoseSearch, GivesNoPlaceTwice) {
  const Eigen::Isometry3d T = pose_at(60.0, 0.0, 0.02);
  // Off by several steps of the yaw, to both sides.
  for (const double off_rad : {-0.25, 0.25}) {
    const Eigen::Isometry3d prior = pose_at(60.0, 0.0, 0.02 + off_rad);
    const maps::PointCloud scan = street().world.scan(T, pattern(7));
    const Query query = query_of(picked(view_of(scan), thin_points(view_of(scan))), prior.linear());
    const auto window = street().index->around(prior.translation());
    const MapIndex::Level& level = window->levels()[1];
    ASSERT_EQ(level.edge_m, 1.0F);
    const std::vector<Eigen::Isometry3d> found =
        search_poses(level, window->origin(), query, prior,
                     {.radius_m = 6.0, .yaw_rad = 0.4, .max_candidates = 6});
    ASSERT_GE(found.size(), 6U);
    for (std::size_t i = 0; i < found.size(); ++i) {
      for (std::size_t k = 0; k < i; ++k) {
        const Eigen::Isometry3d apart = found[i].inverse() * found[k];
        const double apart_m = apart.translation().head<2>().cwiseAbs().maxCoeff();
        EXPECT_TRUE(apart_m > 1.1 * level.edge_m ||
                    maps::rotation_angle_rad(apart.linear()) > 2.5 * 0.035)
            << i << " and " << k;
      }
    }
  }
}

TEST(WithoutPrior, FindsTheScanOfATiltedOrHangingSensorInEveryHeading) {
  for (const double tilt_rad : {0.44, std::numbers::pi}) {
    Eigen::Isometry3d T_base_lidar = Eigen::Isometry3d::Identity();
    T_base_lidar.linear() =
        Eigen::AngleAxisd(tilt_rad, Eigen::Vector3d(0.6, 0.8, 0.0)).toRotationMatrix();
    test::ScanPattern wide = pattern(100);
    wide.lowest_rad = -0.8;
    wide.highest_rad = 0.8;
    wide.rings = 64;
    std::vector<Eigen::Isometry3d> poses;
    for (const Eigen::Isometry3d& T : drive_through()) poses.push_back(T * T_base_lidar);
    const auto aligner =
        make_aligner("default", MapIndex::build(street().world.mapped_from(poses, wide)), poses);
    for (double yaw = -3.0; yaw < 3.1; yaw += 1.1) {
      const Eigen::Isometry3d T = pose_at(61.5, -0.7, yaw) * T_base_lidar;
      const auto scan = street().world.scan(T, wide);
      const AlignmentResult result = aligner->align(scan, std::nullopt);
      EXPECT_EQ(result.status, PoseStatus::kOk) << tilt_rad << " " << yaw;
      EXPECT_LT((T.inverse() * result.T_map_lidar).translation().norm(), 0.1)
          << tilt_rad << " " << yaw;
    }
  }
}

TEST(WithoutPrior, FindsTheScansOfAnUprightSensorWhereATiltedOneDroveAsWell) {
  std::vector<Eigen::Isometry3d> poses = drive_through();
  const std::size_t upright = poses.size();
  for (std::size_t i = 0; i < upright; ++i)
    poses.push_back(poses[i] * Eigen::AngleAxisd(0.6, Eigen::Vector3d::UnitY()));
  const auto aligner = make_aligner("default", street().index, poses);
  for (double yaw = -3.0; yaw < 3.1; yaw += 1.1) {
    const Eigen::Isometry3d T = pose_at(61.5, -0.7, yaw);
    const AlignmentResult result = aligner->align(street().world.scan(T, pattern(7)), std::nullopt);
    EXPECT_EQ(result.status, PoseStatus::kOk) << yaw;
    EXPECT_LT((T.inverse() * result.T_map_lidar).translation().norm(), 0.1) << yaw;
  }
}

TEST(WithoutPrior, FollowsTheSlopeOfThePlace) {
  // The same street on a hillside of 10 %: map, poses and scans turned together.
  Eigen::Isometry3d T_hill = Eigen::Isometry3d::Identity();
  T_hill.linear() = Eigen::AngleAxisd(-0.1, Eigen::Vector3d::UnitY()).toRotationMatrix();
  std::vector<Eigen::Vector3d> points;
  for (const Eigen::Vector3d& p : street().points_map) points.emplace_back(T_hill * p);
  std::vector<Eigen::Isometry3d> poses;
  for (const Eigen::Isometry3d& T : drive_through()) poses.emplace_back(T_hill * T);
  const auto aligner = make_aligner("default", MapIndex::build(points), poses);
  const Eigen::Isometry3d T = pose_at(70.0, 0.4, std::numbers::pi);
  const AlignmentResult result = aligner->align(street().world.scan(T, pattern(9)), std::nullopt);
  EXPECT_LT(((T_hill * T).inverse() * result.T_map_lidar).translation().norm(), 0.1);
}

TEST(WithoutPrior, IsNotOkInAnotherStreet) {
  const test::SyntheticWorld elsewhere = test::street(99);
  int ok = 0;
  for (const double x : {30.0, 45.0, 60.0, 75.0, 90.0}) {
    const auto scan = elsewhere.scan(pose_at(x, 0.0, 0.4), pattern(3));
    if (street().aligner->align(scan, std::nullopt).status == PoseStatus::kOk) ++ok;
  }
  EXPECT_EQ(ok, 0);
}

TEST(WithoutPrior, GivesTheSameAnswerTwice) {
  const auto scan = street().world.scan(pose_at(50.0, 0.0, 1.0), pattern(5));
  const AlignmentResult one = street().aligner->align(scan, std::nullopt);
  const AlignmentResult two = street().aligner->align(scan, std::nullopt);
  EXPECT_EQ(one.T_map_lidar.matrix(), two.T_map_lidar.matrix());
  EXPECT_EQ(one.covariance, two.covariance);
}

Prior gnss_prior(const Eigen::Isometry3d& T_map_lidar, double sigma_m, double sigma_rad) {
  Eigen::Matrix<double, 6, 1> sigma;
  sigma << Eigen::Vector3d::Constant(sigma_m), Eigen::Vector3d::Constant(sigma_rad);
  return {T_map_lidar, sigma.cwiseAbs2().asDiagonal().toDenseMatrix()};
}

TEST(WidePrior, FindsTheScanWithinItsDeviationsInEveryHeading) {
  const Eigen::Isometry3d T = pose_at(61.5, -0.7, 2.0);
  const auto scan = street().world.scan(T, pattern(7));
  for (const double x : {42.0, 80.0}) {
    const AlignmentResult result =
        street().aligner->align(scan, gnss_prior(pose_at(x, 1.0, -1.0), 10.0, 1.5));
    EXPECT_EQ(result.status, PoseStatus::kOk) << x;
    EXPECT_LT((T.inverse() * result.T_map_lidar).translation().norm(), 0.1) << x;
  }
}

TEST(LatePrior, FindsTheScanAFewSecondsOfDrivingAhead) {
  const Eigen::Isometry3d T = pose_at(75.0, -0.7, 0.1);
  const auto scan = street().world.scan(T, pattern(7));
  const AlignmentResult result =
      street().aligner->align(scan, Prior{pose_at(53.0, 0.3, -0.2), std::nullopt});
  EXPECT_EQ(result.status, PoseStatus::kOk);
  EXPECT_LT((T.inverse() * result.T_map_lidar).translation().norm(), 0.1);
}

TEST(LatePrior, FindsTheScanWhereWhatIsNearThePriorFitsHalfAndDoubtsIt) {
  std::ptrdiff_t doubted = 0;
  for (const double off_m : {-14.0, -12.0, -10.0, 10.0, 12.0, 14.0}) {
    const Eigen::Isometry3d T = pose_at(65.0, -0.7, 0.1);
    const AlignmentResult result = street().aligner->align(
        street().world.scan(T, pattern(7)), Prior{pose_at(65.0 + off_m, 0.3, -0.1), std::nullopt});
    EXPECT_NE(result.status, PoseStatus::kLost) << off_m;
    // Near the prior it could be a place that has changed.
    doubted += std::count(result.reasons.begin(), result.reasons.end(), Reason::kAmbiguous);
    EXPECT_LT((T.inverse() * result.T_map_lidar).translation().norm(), 0.1) << off_m;
  }
  EXPECT_GE(doubted, 3);
}

TEST(WidePrior, DoesNotLookBeyondItsDeviations) {
  const auto scan = street().world.scan(pose_at(100.0, -0.7, 0.0), pattern(7));
  const AlignmentResult result =
      street().aligner->align(scan, gnss_prior(pose_at(30.0, 0.0, 0.0), 8.0, 0.1));
  EXPECT_NE(result.status, PoseStatus::kOk);
  EXPECT_LT(result.T_map_lidar.translation().x(), 70.0);
}

TEST(WithoutPrior, IsLostWithNothingToGoBy) {
  EXPECT_EQ(street().aligner->align({}, std::nullopt).status, PoseStatus::kLost);
  maps::PointCloud flat;
  for (int x = -40; x < 40; ++x) {
    for (int y = -40; y < 40; ++y) {
      flat.positions.emplace_back(static_cast<float>(x), static_cast<float>(y), -1.7F);
    }
  }
  const AlignmentResult result = street().aligner->align(flat, std::nullopt);
  EXPECT_EQ(result.status, PoseStatus::kLost);
  EXPECT_THAT(result.reasons, testing::ElementsAre(Reason::kTooLittleStructure));
}

TEST(WithoutPrior, RefusesWhatIsNotFinite) {
  maps::PointCloud scan = street().world.scan(pose_at(50.0, 0.0, 0.0), pattern(5));
  scan.positions[10].x() = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW((void)street().aligner->align(scan, std::nullopt), std::invalid_argument);
  std::vector<Eigen::Isometry3d> broken = drive_through();
  broken[1].translation().y() = std::numeric_limits<double>::infinity();
  EXPECT_THROW((void)make_aligner("default", street().index, broken), std::invalid_argument);
}

TEST(WithoutPrior, SaysThatAMapWithoutPosesNeedsOne) {
  const auto aligner = make_aligner("default", street().index);
  const auto scan = street().world.scan(pose_at(50.0, 0.0, 0.0), pattern(5));
  EXPECT_THAT(aligner->align(scan, std::nullopt).reasons,
              testing::ElementsAre(Reason::kNeedsPrior));
}

}  // namespace without_prior_test
}  // namespace stillmap::localization
