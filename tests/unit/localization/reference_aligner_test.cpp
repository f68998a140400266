#include "reference/reference_aligner.hpp"

#include "align/registration.hpp"
#include "reference/icp.hpp"
#include "reference/point_to_plane.hpp"

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/frames.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>

#include <cmath>
#include <limits>
#include <stdexcept>

namespace stillmap::localization {
namespace reference_aligner_test {

using test::pose_at;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::Not;

test::ScanPattern pattern(std::uint64_t seed) {
  test::ScanPattern out;
  out.columns = 360;
  out.noise_m = 0.02;
  out.seed = seed;
  return out;
}

std::vector<Eigen::Vector3d> driven_through(const test::SyntheticWorld& world) {
  std::vector<Eigen::Isometry3d> poses;
  for (double x = 30.0; x <= 90.0; x += 3.0) poses.push_back(pose_at(x, 0.0));
  return world.mapped_from(poses, pattern(50));
}

ReferenceAligner aligner_of(const std::vector<Eigen::Vector3d>& points_map,
                            const ReferenceMethod& method) {
  return {MapPoints::build(points_map, method.map_leaf_m), method};
}

struct Street {
  test::SyntheticWorld world = test::street(31);
  std::vector<Eigen::Vector3d> points_map = driven_through(world);
  ReferenceAligner icp_aligner = aligner_of(points_map, icp());
  ReferenceAligner plane_aligner = aligner_of(points_map, point_to_plane());

  [[nodiscard]] std::vector<const ReferenceAligner*> both() const {
    return {&icp_aligner, &plane_aligner};
  }
};
const Street& street() {
  static const Street built;
  return built;
}

Prior prior_at(const Eigen::Isometry3d& T) { return {T, std::nullopt}; }

double distance_m(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return (a.inverse() * b).translation().norm();
}

TEST(ReferenceAligner, FindsTheScanFromNearbyPriors) {
  const Eigen::Isometry3d T = pose_at(60.0, 0.5, 0.05);
  const maps::PointCloud scan = street().world.scan(T, pattern(7));
  for (const double off_m : {0.0, 0.3, 1.0}) {
    for (const ReferenceAligner* aligner : street().both()) {
      const bool is_icp = aligner == &street().icp_aligner;
      const AlignmentResult result =
          aligner->align(scan, prior_at(pose_at(60.0 + off_m, 0.5, 0.05 + 0.03 * off_m)));
      EXPECT_EQ(result.status, PoseStatus::kOk)
          << ::testing::PrintToString(names_of(result.reasons));
      const Eigen::Isometry3d error = T.inverse() * result.T_map_lidar;
      EXPECT_LT(error.translation().norm(), is_icp ? 0.06 : 0.02) << off_m;
      EXPECT_LT(maps::rotation_angle_rad(error.linear()), is_icp ? 0.003 : 0.001) << off_m;
      EXPECT_GT(result.inlier_ratio, 0.9);
      EXPECT_TRUE(std::isinf(result.protection.lateral_m));
      const Vector6d normalised = result.covariance.llt().matrixL().solve(maps::log_se3(error));
      EXPECT_LT(normalised.squaredNorm(), 22.5) << "beyond its covariance from " << off_m << " m";
    }
  }
}

TEST(ReferenceAligner, AnswerFollowsAMapThatIsFarFromTheOrigin) {
  Eigen::Isometry3d T_new_map = Eigen::Isometry3d::Identity();
  T_new_map.translation() = Eigen::Vector3d(431'000.0, -5'400'000.0, 210.0);
  std::vector<Eigen::Vector3d> points_new = street().points_map;
  for (Eigen::Vector3d& p : points_new) p = T_new_map * p;
  const Eigen::Isometry3d T = pose_at(60.0, -0.5, 0.1);
  const maps::PointCloud scan = street().world.scan(T, pattern(8));
  const Prior prior = prior_at(pose_at(60.4, -0.7, 0.12));
  const Prior prior_new = prior_at(T_new_map * prior.T_map_lidar);
  EXPECT_LT(distance_m(T_new_map * street().icp_aligner.align(scan, prior).T_map_lidar,
                       aligner_of(points_new, icp()).align(scan, prior_new).T_map_lidar),
            1e-3);
  EXPECT_LT(distance_m(T_new_map * street().plane_aligner.align(scan, prior).T_map_lidar,
                       aligner_of(points_new, point_to_plane()).align(scan, prior_new).T_map_lidar),
            1e-3);
}

TEST(ReferenceAligner, FarPriorIsNeverOk) {
  const maps::PointCloud scan = street().world.scan(pose_at(60.0, 0.5), pattern(9));
  for (const ReferenceAligner* aligner : street().both()) {
    for (const double off_m : {12.0, -20.0}) {
      const AlignmentResult result = aligner->align(scan, prior_at(pose_at(60.0 + off_m, 0.5)));
      EXPECT_NE(result.status, PoseStatus::kOk) << off_m;
      EXPECT_THAT(result.reasons, Contains(Reason::kLowInlierRatio)) << off_m;
    }
    EXPECT_THAT(aligner->align(scan, prior_at(pose_at(5000.0, 0.0))).reasons,
                ElementsAre(Reason::kOutsideMap));
    EXPECT_THAT(aligner->align(scan, prior_at(pose_at(60.0, 0.0, 0.0, 80.0))).reasons,
                ElementsAre(Reason::kLittleOverlap));
    EXPECT_EQ(aligner->align(scan, prior_at(pose_at(1e300, 0.0))).status, PoseStatus::kLost);
  }
}

TEST(ReferenceAligner, DirectionAlongACorridorIsUnobservable) {
  const test::SyntheticWorld corridor = test::corridor();
  const std::vector<Eigen::Vector3d> points_map = driven_through(corridor);
  const maps::PointCloud scan = corridor.scan(pose_at(60.0, 0.3), pattern(10));
  for (const auto* method : {&icp(), &point_to_plane()}) {
    const AlignmentResult result =
        aligner_of(points_map, *method).align(scan, prior_at(pose_at(60.4, 0.1)));
    EXPECT_EQ(result.status, PoseStatus::kDegraded);
    EXPECT_THAT(result.reasons, Contains(Reason::kUnobservableDirection));
    EXPECT_GT(std::sqrt(result.covariance(0, 0)), 5.0);
    // Across it both know where they are; pairs at the corridor's far ends bend icp by centimetres.
    EXPECT_NEAR(result.T_map_lidar.translation().y(), 0.3, 0.12);
  }
}

TEST(ReferenceAligner, PriorWhoseCovarianceSpeaksAgainstThePoseIsNamed) {
  const maps::PointCloud scan = street().world.scan(pose_at(60.0, 0.5), pattern(11));
  Prior prior = prior_at(pose_at(60.0, -0.5));
  prior.covariance = 1e-4 * Matrix6d::Identity();
  for (const ReferenceAligner* aligner : street().both()) {
    const AlignmentResult result = aligner->align(scan, prior);
    EXPECT_EQ(result.status, PoseStatus::kDegraded);
    EXPECT_THAT(result.reasons, Contains(Reason::kContradictsPrior));
  }
}

TEST(ReferenceAligner, NeedsAPriorPointsAndFiniteNumbers) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const Eigen::Isometry3d T = pose_at(60.0, 0.5);
  maps::PointCloud scan = street().world.scan(T, pattern(12));
  maps::PointCloud tiny;
  tiny.positions.assign(10'000, Eigen::Vector3f(5.0F, 1.0F, 0.0F));
  for (const ReferenceAligner* aligner : street().both()) {
    EXPECT_THAT(aligner->align(scan, std::nullopt).reasons, ElementsAre(Reason::kNeedsPrior));
    EXPECT_THAT(aligner->align({}, prior_at(T)).reasons, ElementsAre(Reason::kTooFewPoints));
    EXPECT_THAT(aligner->align(tiny, prior_at(T)).reasons, ElementsAre(Reason::kTooFewPoints));
    Prior broken = prior_at(T);
    broken.T_map_lidar.linear() *= 1.1;
    EXPECT_THROW((void)aligner->align(scan, broken), std::invalid_argument);
    maps::PointCloud not_finite = scan;
    not_finite.positions[100].y() = nan;
    EXPECT_THROW((void)aligner->align(not_finite, prior_at(T)), std::invalid_argument);
    maps::PointCloud far = scan;
    far.positions.emplace_back(3e38F, 0.0F, 0.0F);
    EXPECT_EQ(aligner->align(far, prior_at(T)).T_map_lidar.matrix(),
              aligner->align(scan, prior_at(T)).T_map_lidar.matrix());
  }
  EXPECT_THROW(ReferenceAligner(nullptr, icp()), std::invalid_argument);
}

TEST(BestRigid, TurnsAnLByNinetyDegreesAndMovesIt) {
  const std::vector<Eigen::Vector3d> from = {{0, 0, 0}, {1, 0, 0}, {0, 2, 0}, {0, 0, 3}};
  const std::vector<Eigen::Vector3d> to = {{5, 6, 7}, {5, 7, 7}, {3, 6, 7}, {5, 6, 10}};
  const Eigen::Isometry3d T = best_rigid(from, to);
  Eigen::Matrix4d expected;
  expected << 0, -1, 0, 5, 1, 0, 0, 6, 0, 0, 1, 7, 0, 0, 0, 1;
  EXPECT_LT((T.matrix() - expected).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(BestRigid, TurnsFlatPointsThatAreMirroredAsIfTheyWereNot) {
  // Cross-covariance R diag(18, 8, -0.04): R and a mirror fit exactly, of all rotations R does
  // best.
  const Eigen::Matrix3d R =
      Eigen::AngleAxisd(1.0, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  const std::vector<Eigen::Vector3d> from = {
      {3, 0, 0.1}, {-3, 0, 0.1}, {0, 2, -0.1}, {0, -2, -0.1}};
  std::vector<Eigen::Vector3d> to;
  for (const Eigen::Vector3d& p : from) to.emplace_back(R * Eigen::Vector3d(p.x(), p.y(), -p.z()));
  EXPECT_LT((best_rigid(from, to).linear() - R).cwiseAbs().maxCoeff(), 1e-9);
}

TEST(BestRigid, WantsAsManyPointsOfBoth) {
  const std::vector<Eigen::Vector3d> one(1, Eigen::Vector3d::Ones());
  const std::vector<Eigen::Vector3d> two(2, Eigen::Vector3d::Ones());
  EXPECT_THROW((void)best_rigid(one, two), std::invalid_argument);
  EXPECT_THROW((void)best_rigid({}, {}), std::invalid_argument);
  EXPECT_TRUE(best_rigid(two, two).matrix().allFinite());
}

TEST(MapPoints, OneCentroidACell) {
  const std::vector<Eigen::Vector3f> points = {
      {0.1F, 0.1F, 0.1F}, {0.3F, 0.1F, 0.1F}, {-0.1F, 0.1F, 0.1F}, {600.0F, 0.0F, 0.0F}};
  const std::vector<Eigen::Vector3f> kept = thinned(points, 0.5);
  ASSERT_EQ(kept.size(), 2U);
  EXPECT_LT((kept[0] - Eigen::Vector3f(0.2F, 0.1F, 0.1F)).norm(), 1e-6F);
  EXPECT_LT((kept[1] - Eigen::Vector3f(-0.1F, 0.1F, 0.1F)).norm(), 1e-6F);
}

TEST(ReferenceAligner, SaysThatItTakesNoMotionOutOfAScan) {
  const Eigen::Isometry3d T = pose_at(60.0, 0.5, 0.05);
  maps::PointCloud scan = street().world.scan(T, pattern(7));
  scan.time_offsets_s.assign(scan.size(), 0.0F);
  const auto answer = [&] { return street().plane_aligner.align(scan, prior_at(T)); };
  EXPECT_EQ(answer().status, PoseStatus::kOk);
  scan.time_offsets_s.front() = -0.05F;
  EXPECT_EQ(answer().status, PoseStatus::kDegraded);
  EXPECT_THAT(answer().reasons, Contains(Reason::kNotDeskewed));
}

TEST(MapPoints, TellPlanesUprightLinesAndLyingOnesApart) {
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 20; ++i) {
    for (int j = 0; j < 20; ++j) points.emplace_back(i, j, 0.0);
    points.emplace_back(100.0, 0.0, i);
    points.emplace_back(200.0 + i, 0.0, 0.0);
  }
  const auto map = MapPoints::build(points, 0.5);
  const auto at = [&](double x, double y, double z) {
    return map->nearest((Eigen::Vector3d(x, y, z) - map->origin()).cast<float>(), 0.1F);
  };
  ASSERT_NE(at(10, 10, 0), nullptr);
  EXPECT_EQ(at(10, 10, 0)->sharp_axes, 1);
  EXPECT_NEAR(std::abs(at(10, 10, 0)->axes[0].z()), 1.0F, 1e-5F);
  EXPECT_EQ(at(100, 0, 10)->sharp_axes, 2);
  EXPECT_EQ(at(210, 0, 0)->sharp_axes, 0);
  EXPECT_EQ(at(50, 50, 50), nullptr);
}

TEST(MapPoints, WantAPointAndAnEdge) {
  EXPECT_THROW((void)MapPoints::build(std::vector<Eigen::Vector3d>{}, 0.5), maps::InputError);
  EXPECT_THROW((void)MapPoints::build({Eigen::Vector3d::Zero()}, 0.0), std::invalid_argument);
  EXPECT_THROW((void)MapPoints::build({Eigen::Vector3d::Zero(), {1e7, 0, 0}}, 0.5),
               maps::InputError);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW((void)MapPoints::build({Eigen::Vector3d::Zero(), {0, nan, 0}}, 0.5),
               std::invalid_argument);
  EXPECT_EQ(MapPoints::build({Eigen::Vector3d::Zero()}, 0.5)->points().size(), 1U);
}

}  // namespace reference_aligner_test
}  // namespace stillmap::localization
