#include "registration/map_following.hpp"

#include <stillmap/maps/frames.hpp>

#include <gtest/gtest.h>

#include <cmath>

#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace map_following_test {

/// A way of 200 m, a pose each metre.
std::vector<Eigen::Isometry3d> way() {
  std::vector<Eigen::Isometry3d> poses;
  for (int i = 0; i <= 200; ++i)
    poses.push_back(test::pose_at(i, 3.0 * std::sin(0.05 * i), 0.15 * std::cos(0.05 * i)));
  return poses;
}

/// The same as a map has it that is bent: up to 0.2 m and 0.4 deg over 100 m.
Eigen::Isometry3d bent(const Eigen::Isometry3d& T) {
  const double phase = 0.03 * T.translation().x();
  Eigen::Isometry3d out = T;
  out.linear() =
      Eigen::AngleAxisd(0.007 * std::sin(phase), Eigen::Vector3d::UnitZ()).toRotationMatrix() *
      T.linear();
  out.translation() += Eigen::Vector3d(0.05, 0.2 * std::sin(phase), 0.03 * std::cos(phase));
  return out;
}

std::vector<FoundScan> found_in_map(std::size_t step, double noise_m, std::size_t end = 201) {
  test::Random random(5);
  const auto poses = way();
  std::vector<FoundScan> found;
  for (std::size_t i = 0; i < end; i += step) {
    FoundScan each{i, bent(poses[i]), 1e-4 * maps::Matrix6d::Identity()};
    each.T_map_lidar.translation() +=
        noise_m * Eigen::Vector3d(random.normal(), random.normal(), random.normal());
    found.push_back(each);
  }
  return found;
}

double worst_m(const std::vector<Eigen::Isometry3d>& poses, std::size_t end = 201) {
  double worst = 0.0;
  for (std::size_t i = 0; i < end; ++i)
    worst = std::max(worst, (poses[i].translation() - bent(way()[i]).translation()).norm());
  return worst;
}

TEST(MapFollowing, BendsADriveAsTheMapIsBent) {
  EXPECT_GT(worst_m(way()), 0.2);
  const auto poses = following(way(), found_in_map(2, 0.0));
  EXPECT_LT(worst_m(poses), 0.012);
  for (std::size_t i = 0; i < poses.size(); ++i)
    EXPECT_LT(maps::rotation_angle_rad(poses[i].linear().transpose() * bent(way()[i]).linear()),
              1e-3);
}

TEST(MapFollowing, AveragesTheNoiseOfAnswers) {
  double worst_answer = 0.0;
  for (const FoundScan& each : found_in_map(1, 0.02))
    worst_answer =
        std::max(worst_answer,
                 (each.T_map_lidar.translation() - bent(way()[each.scan]).translation()).norm());
  EXPECT_LT(worst_m(following(way(), found_in_map(1, 0.02))), worst_answer / 2.0);
}

TEST(MapFollowing, GoesOnAsItWasBeyondTheMap) {
  const auto poses = following(way(), found_in_map(2, 0.0, 101));
  EXPECT_LT(worst_m(poses, 95), 0.012);
  // The last correction stays: no step, no turn of the rest.
  const auto own = way();
  const Eigen::Vector3d at_end = poses[120].translation() - own[120].translation();
  EXPECT_LT((poses[200].translation() - own[200].translation() - at_end).norm(), 1e-9);
  for (std::size_t i = 1; i < poses.size(); ++i) {
    const Eigen::Vector3d step = poses[i].translation() - poses[i - 1].translation();
    EXPECT_LT((step - (own[i].translation() - own[i - 1].translation())).norm(), 0.02);
  }
}

TEST(MapFollowing, MakesNoStepWhereScansWereNotFound) {
  std::vector<FoundScan> found = found_in_map(2, 0.0);
  std::erase_if(found, [](const FoundScan& each) { return each.scan > 60 && each.scan < 110; });
  const auto poses = following(way(), found), own = way();
  for (std::size_t i = 1; i < poses.size(); ++i) {
    const Eigen::Vector3d step = poses[i].translation() - poses[i - 1].translation();
    EXPECT_LT((step - (own[i].translation() - own[i - 1].translation())).norm(), 0.02) << i;
  }
}

TEST(MapFollowing, TellsWhichPosesTheMapKnows) {
  std::vector<FoundScan> found = found_in_map(2, 0.0, 101);
  std::erase_if(found, [](const FoundScan& each) { return each.scan > 20 && each.scan < 80; });
  const std::vector<bool> known = known_by_map(way(), found);
  EXPECT_TRUE(known[0] && known[20] && known[30] && known[70] && known[100] && known[110]);
  EXPECT_FALSE(known[50] || known[120] || known[200]);
  EXPECT_EQ(known_by_map(way(), {}), std::vector<bool>(201, false));
}

TEST(MapFollowing, ChangesNothingWithoutAnswers) {
  const auto poses = following(way(), {});
  EXPECT_EQ(poses[7].matrix(), way()[7].matrix());
}

}  // namespace map_following_test
}  // namespace stillmap::mapping
