// A scan that sees one face of thin walls, in a map that holds both faces.
#include <stillmap/localization/aligner.hpp>

#include <gtest/gtest.h>

#include <support/synthetic_world.hpp>

#include <cmath>
#include <memory>
#include <vector>

namespace stillmap::localization {
namespace near_rivals_test {

using test::pose_at;

test::ScanPattern pattern(std::uint64_t seed) {
  test::ScanPattern out;
  out.columns = 720;
  out.noise_m = 0.02;
  out.seed = seed;
  return out;
}

/// Walls along x and across it, every 30 m.
test::SyntheticWorld yards(double thickness_m) {
  test::SyntheticWorld world;
  for (double x = 0.0; x < 120.0; x += 30.0) {
    world.boxes.push_back({{x, 6.0, 0.0}, {x + 26.0, 6.0 + thickness_m, 3.0}});
    world.boxes.push_back({{x + 27.0, 2.0, 0.0}, {x + 27.0 + thickness_m, 5.0, 3.0}});
  }
  return world;
}

TEST(NearRivals, TheOtherFaceOfAThinWallIsWithinTheLevels) {
  for (const double thickness_m : {0.2, 0.3, 0.4}) {
    const test::SyntheticWorld world = yards(thickness_m);
    std::vector<Eigen::Isometry3d> poses;
    for (double x = 20.0; x <= 100.0; x += 2.0) {
      poses.push_back(pose_at(x, 0.0));
      poses.push_back(pose_at(x, 12.0));
    }
    const auto aligner =
        make_aligner("default", MapIndex::build(world.mapped_from(poses, pattern(50))), poses);
    int ok = 0;
    for (int query = 0; query < 40; ++query) {
      const double share = query;
      const Eigen::Isometry3d T = pose_at(40.0 + share, 0.2 * std::sin(share));
      const Eigen::Isometry3d off =
          pose_at(0.5 * std::cos(7.0 * share), 0.6 * std::sin(3.0 * share), 0.0, 0.0);
      const AlignmentResult found = aligner->align(
          world.scan(T, pattern(1000 + static_cast<std::uint64_t>(query))), Prior{off * T, {}});
      if (found.status != PoseStatus::kOk) continue;
      ++ok;
      const Eigen::Vector3d error = (T.inverse() * found.T_map_lidar).translation();
      EXPECT_LT(std::abs(error.x()), found.protection.longitudinal_m)
          << thickness_m << " " << query;
      EXPECT_LT(std::abs(error.y()), found.protection.lateral_m) << thickness_m << " " << query;
    }
    EXPECT_GE(ok, 5) << thickness_m;
  }
}

TEST(NearRivals, AStreetHasNone) {
  const test::SyntheticWorld world = test::street(31);
  std::vector<Eigen::Isometry3d> poses;
  for (double x = 30.0; x <= 90.0; x += 3.0) poses.push_back(pose_at(x, 0.0));
  const auto aligner =
      make_aligner("default", MapIndex::build(world.mapped_from(poses, pattern(50))), poses);
  for (double x = 35.0; x < 85.0; x += 5.0) {
    const Eigen::Isometry3d T = pose_at(x, 0.3);
    const AlignmentResult found = aligner->align(world.scan(T, pattern(7)), Prior{T, {}});
    ASSERT_EQ(found.status, PoseStatus::kOk) << x;
    EXPECT_LT(found.protection.lateral_m, 0.1) << x;
    EXPECT_LT(found.protection.longitudinal_m, 0.1) << x;
  }
}

}  // namespace near_rivals_test
}  // namespace stillmap::localization
