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

}  // namespace frame_tree_test
}  // namespace stillmap::maps
