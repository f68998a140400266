#include "bags/frame_tree.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace stillmap::maps {
namespace frame_tree_test {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

Eigen::Isometry3d at(double x) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation().x() = x;
  return T;
}

/// odom -> base_link -> lidar, all on /tf. @param mounts  places of the lidar, one a message.
FrameTree tree_of(const std::vector<double>& mounts, const std::string& parent = "base_link") {
  FrameTree tree;
  for (std::size_t i = 0; i < mounts.size(); ++i) {
    tree.add_moving("odom", "base_link", at(static_cast<double>(i)), "test");
    tree.add_moving(parent, "lidar", at(mounts[i]), "test");
  }
  return tree;
}

TEST(FrameTree, WhatTfRepeatsWithoutAChangeIsRigid) {
  FrameTree tree = tree_of({1.5, 1.5, 1.5});
  EXPECT_FALSE(tree.T_between("base_link", "lidar"));
  EXPECT_THAT(tree.settle_unmoved(), ElementsAre("lidar"));
  const auto T = tree.T_between("base_link", "lidar");
  ASSERT_TRUE(T);
  EXPECT_EQ(T->translation().x(), 1.5);
}

TEST(FrameTree, WhatMovesOnceOrIsSaidTwiceStaysMoving) {
  for (const std::vector<double>& mounts :
       {std::vector{1.5, 1.5, 1.5, 1.500001}, std::vector{1.5, 1.6, 1.5, 1.5},
        std::vector{1.5, 1.5}}) {
    FrameTree tree = tree_of(mounts);
    EXPECT_THAT(tree.settle_unmoved(), IsEmpty());
    EXPECT_FALSE(tree.T_between("base_link", "lidar"));
  }
}

TEST(FrameTree, AParkedVehicleIsNotPartOfTheGround) {
  for (const char* fixed : {"odom", "map", "/robot/odom", "world", "earth"}) {
    FrameTree tree = tree_of({1.5, 1.5, 1.5}, fixed);
    EXPECT_THAT(tree.settle_unmoved(), IsEmpty()) << fixed;
  }
}

TEST(FrameTree, AMessageThatCannotBeReadChangesNothing) {
  FrameTree tree = tree_of({1.5, 1.5, 1.5});
  tree.add_moving("base_link", "lidar", std::nullopt, "test");
  EXPECT_EQ(tree.settle_unmoved().size(), 1U);
}

TEST(FrameTree, AFrameDoesNotStandInItself) {
  FrameTree tree;
  tree.add_moving("odom", "odom", at(1.0), "test");
  tree.add_rigid("odom", "odom", at(1.0), "test");
  EXPECT_THAT(tree.steps_above("odom"), IsEmpty());
  EXPECT_THAT(tree.moving_below("odom"), IsEmpty());
  EXPECT_FALSE(tree.has_rigid("odom"));
}

TEST(FrameTree, FramesInACircleHaveNoneAbove) {
  FrameTree tree;
  tree.add_moving("map", "odom", at(1.0), "test");
  tree.add_moving("odom", "map", at(1.0), "test");
  tree.add_rigid("odom", "lidar", at(1.0), "test");
  EXPECT_THAT(tree.steps_above("lidar"), IsEmpty());
  tree.add_rigid("a", "b", at(1.0), "test");
  tree.add_rigid("b", "a", at(1.0), "test");
  EXPECT_FALSE(tree.T_between("a", "lidar"));
}

TEST(FrameTree, JoinsFramesOfAsManyStepsAsARobotHas) {
  FrameTree tree;
  const auto frame = [](std::size_t i) { return "f" + std::to_string(i); };
  for (std::size_t i = 0; i <= FrameTree::kMostSteps; ++i)
    tree.add_rigid(frame(i + 1), frame(i), at(1.0), "test");
  const auto T = tree.T_between(frame(FrameTree::kMostSteps), frame(0));
  ASSERT_TRUE(T);
  EXPECT_EQ(T->translation().x(), static_cast<double>(FrameTree::kMostSteps));
  EXPECT_FALSE(tree.T_between(frame(FrameTree::kMostSteps + 1), frame(0)));
}

}  // namespace frame_tree_test
}  // namespace stillmap::maps
