// What a map says of how far it is bent, and what answers make of it.
#include "index/own_error.hpp"

#include <stillmap/localization/aligner.hpp>
#include <stillmap/maps/map_package.hpp>

#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>
#include <support/temporary_folder.hpp>
#include <support/tiled_map.hpp>

#include <memory>
#include <string>
#include <vector>

namespace stillmap::localization {
namespace own_error_test {

using test::pose_at;

test::ScanPattern pattern(std::uint64_t seed) {
  test::ScanPattern out;
  out.columns = 360;
  out.noise_m = 0.02;
  out.seed = seed;
  return out;
}

/// A street seen from poses 3 m apart, from x = 30 to 90 m.
class Street {
 public:
  /// @param disagreements  empty = the package says nothing.
  std::shared_ptr<const maps::MapPackage> map(
      const std::vector<maps::PoseDisagreement>& disagreements) {
    std::vector<maps::StampedPose> stamped;
    for (const Eigen::Isometry3d& T : poses_)
      stamped.push_back({static_cast<std::int64_t>(stamped.size()), T});
    std::vector<maps::MapPoint> points;
    for (const Eigen::Vector3d& at : world_.mapped_from(poses_, pattern(50))) {
      const Eigen::Vector3f p = at.cast<float>();
      points.push_back(test::map_point(p.x(), p.y(), p.z()));
    }
    return test::write_map(folder_.path() / std::to_string(count_++), points, {},
                           [&](maps::MapPackageWriter& writer) {
                             writer.write_trajectory(maps::Trajectory(std::move(stamped)));
                             if (!disagreements.empty())
                               maps::write_pose_disagreements(writer.folder(), disagreements);
                           });
  }
  [[nodiscard]] std::size_t poses() const { return poses_.size(); }
  [[nodiscard]] AlignmentResult asked(const maps::MapPackage& map) const {
    const Eigen::Isometry3d T = pose_at(61.0, 0.3);
    return make_aligner("default", map)->align(world_.scan(T, pattern(7)), Prior{T, {}});
  }

 private:
  static std::vector<Eigen::Isometry3d> places() {
    std::vector<Eigen::Isometry3d> poses;
    for (double x = 30.0; x <= 90.0; x += 3.0) poses.push_back(pose_at(x, 0.0));
    return poses;
  }
  test::TemporaryFolder folder_;
  test::SyntheticWorld world_ = test::street(31);
  std::vector<Eigen::Isometry3d> poses_ = places();
  int count_ = 0;
};

TEST(OwnError, IsTheLargestNearByBeyondOdometrysOwn) {
  Street street;
  std::vector<maps::PoseDisagreement> told(street.poses(), {0.02F, 0.001F});
  told.front() = {0.3F, 0.01F};
  const auto map = street.map(told);
  const std::vector<OwnErrorColumn> columns = own_errors_of(*map);
  EXPECT_NEAR(own_error_near(columns, {30.0, 0.0, 0.0}).m, 0.3F, 0.01F);
  EXPECT_NEAR(own_error_near(columns, {50.0, 0.0, 0.0}).rad, 0.01F, 1e-3F);
  EXPECT_EQ(own_error_near(columns, {90.0, 0.0, 0.0}).m, 0.0F);
  EXPECT_EQ(own_error_near({}, {30.0, 0.0, 0.0}).m, 0.0F);
}

TEST(OwnError, WidensWhatAnAnswerIsBoundBy) {
  Street street;
  const AlignmentResult silent = street.asked(*street.map({}));
  const AlignmentResult whole = street.asked(
      *street.map(std::vector<maps::PoseDisagreement>(street.poses(), {0.02F, 1e-3F})));
  const AlignmentResult bent =
      street.asked(*street.map(std::vector<maps::PoseDisagreement>(street.poses(), {0.3F, 1e-3F})));
  ASSERT_EQ(silent.status, PoseStatus::kOk);
  ASSERT_EQ(bent.status, PoseStatus::kOk);
  EXPECT_TRUE(bent.T_map_lidar.isApprox(silent.T_map_lidar, 0.0));
  EXPECT_EQ(whole.protection.lateral_m, silent.protection.lateral_m);
  EXPECT_GT(bent.protection.lateral_m, 0.2);
  EXPECT_GT(bent.protection.yaw_rad, 2.0 * silent.protection.yaw_rad);
}

}  // namespace own_error_test
}  // namespace stillmap::localization
