#include <stillmap/mapping/reference.hpp>

#include "reference/pcl_gicp.hpp"
#include "reference/pcl_ndt.hpp"

#include <stillmap/maps/frames.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>

#include <cmath>
#include <limits>
#include <stdexcept>

namespace stillmap::mapping {
namespace map_aligners_test {

using test::pose_at;
using ::testing::ElementsAre;
using ::testing::SizeIs;

TEST(MapAligner, NamesTheDefaultFirstAndTheReferences) {
  EXPECT_THAT(map_aligner_names(),
              ElementsAre("default", "icp", "point_to_plane", "pcl-icp", "ndt", "gicp"));
}

template <typename Aligner, typename Options>
struct Method {
  using Settings = Options;

  static const Aligner& in_room() {
    static const Aligner built(
        world().mapped_from({pose_at(-5, 0), pose_at(0, 0), pose_at(5, 0)}, {}), Options{});
    return built;
  }
  static Aligner on(const std::vector<Eigen::Vector3d>& points_map, const Options& options = {}) {
    return {points_map, options};
  }
  static const test::SyntheticWorld& world() {
    static const test::SyntheticWorld built = test::room();
    return built;
  }
};

template <typename T>
class PclReference : public ::testing::Test {};
using Methods =
    ::testing::Types<Method<PclNdtAligner, PclNdtOptions>, Method<PclGicpAligner, PclGicpOptions>>;
TYPED_TEST_SUITE(PclReference, Methods);

localization::Prior at(const Eigen::Isometry3d& T_map_lidar) { return {T_map_lidar, std::nullopt}; }

TYPED_TEST(PclReference, FindsAPoseFromHalfAMetreAway) {
  // Beyond what an epsilon that stops at the first step could reach.
  const Eigen::Isometry3d T_map_lidar = pose_at(1.0, 0.5, 0.2);
  const localization::AlignmentResult result = TypeParam::in_room().align(
      TypeParam::world().scan(T_map_lidar, {}), at(pose_at(1.4, 0.2, 0.25)));
  EXPECT_EQ(result.status, localization::PoseStatus::kOk);
  const Eigen::Isometry3d off = T_map_lidar.inverse() * result.T_map_lidar;
  EXPECT_LT(off.translation().norm(), 0.05);
  EXPECT_LT(maps::rotation_angle_rad(off.linear()), 0.005);
  EXPECT_GT(result.inlier_ratio, 0.9);
  EXPECT_TRUE(result.covariance.isZero());
}

TYPED_TEST(PclReference, AnswersDoNotDependOnWhatWasAskedBefore) {
  const maps::PointCloud here = TypeParam::world().scan(pose_at(1.0, 0.5), {});
  const maps::PointCloud there = TypeParam::world().scan(pose_at(-4.0, 0.0), {});
  const auto& aligner = TypeParam::in_room();
  const auto first = aligner.align(here, at(pose_at(1.2, 0.5)));
  (void)aligner.align(there, at(pose_at(-4.1, 0.2)));
  const auto again = aligner.align(here, at(pose_at(1.2, 0.5)));
  EXPECT_EQ(first.T_map_lidar.matrix(), again.T_map_lidar.matrix());
}

TYPED_TEST(PclReference, FarOriginsCostNoAccuracy) {
  const Eigen::Vector3d far(500000.0, 4000000.0, 100.0);
  std::vector<Eigen::Vector3d> points =
      TypeParam::world().mapped_from({pose_at(-5, 0), pose_at(5, 0)}, {});
  for (Eigen::Vector3d& p : points) p += far;
  const Eigen::Isometry3d T_map_lidar = Eigen::Translation3d(far) * pose_at(1.0, 0.5);
  const auto result =
      TypeParam::on(points).align(TypeParam::world().scan(pose_at(1.0, 0.5), {}),
                                  at(Eigen::Translation3d(far) * pose_at(1.2, 0.4)));
  EXPECT_LT((result.T_map_lidar.translation() - T_map_lidar.translation()).norm(), 0.05);
}

TYPED_TEST(PclReference, TinyScanIsLostAndBrokenInputIsRefused) {
  const auto& aligner = TypeParam::in_room();
  maps::PointCloud scan;
  EXPECT_EQ(aligner.align(scan, at(pose_at(0, 0))).status, localization::PoseStatus::kLost);
  EXPECT_THAT(aligner.align(scan, std::nullopt).reasons,
              ElementsAre(localization::Reason::kNeedsPrior));
  // Many points, but one after thinning.
  scan.positions.assign(100, Eigen::Vector3f(1.0F, 2.0F, 0.0F));
  EXPECT_NO_THROW((void)aligner.align(scan, at(pose_at(0, 0))));
  scan.positions[7].x() = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW((void)aligner.align(scan, at(pose_at(0, 0))), std::invalid_argument);
  Eigen::Isometry3d broken = pose_at(0, 0);
  broken.translation().y() = std::numeric_limits<double>::infinity();
  scan.positions[7].x() = 1.0F;
  EXPECT_THROW((void)aligner.align(scan, at(broken)), std::invalid_argument);
  EXPECT_THROW((void)TypeParam::on({}), std::invalid_argument);
}

TYPED_TEST(PclReference, NamesEveryBrokenBound) {
  typename TypeParam::Settings options;
  EXPECT_THAT(options.violations(), SizeIs(0));
  options.leaf_m = std::numeric_limits<double>::quiet_NaN();
  options.max_iterations = 0;
  EXPECT_THAT(options.violations(), SizeIs(2));
  EXPECT_THROW((void)TypeParam::on({Eigen::Vector3d::Zero()}, options), std::invalid_argument);
}

TEST(PclGicp, AMapTooSmallForCovariancesIsRefused) {
  EXPECT_THROW(PclGicpAligner({Eigen::Vector3d::Zero()}, {}), std::invalid_argument);
}

}  // namespace map_aligners_test
}  // namespace stillmap::mapping
