#include "accuracy/point_to_plane.hpp"

#include <stillmap/maps/frames.hpp>

#include <gtest/gtest.h>

#include <stdexcept>
#include <support/synthetic_world.hpp>

namespace stillmap::test {
namespace {

struct Room {
  SyntheticWorld world = room();
  PointToPlaneReference reference{
      world.mapped_from({pose_at(-5, 0), pose_at(0, 0), pose_at(5, 0)}, {}, 0.05)};
};

const Room& the_room() {
  static const Room built;
  return built;
}

TEST(PointToPlaneReference, FindsATruePoseToMillimetresFromEitherSide) {
  const Eigen::Isometry3d T_map_lidar = pose_at(1.0, 0.5, 0.2);
  const std::vector<Eigen::Vector3f> scan = the_room().world.scan(T_map_lidar, {}).positions;
  for (const double side : {-1.0, 1.0}) {
    const auto found = the_room().reference.align(
        scan, pose_at(1.0 + 0.2 * side, 0.5 - 0.2 * side, 0.2 + 0.01 * side, 1.8 + 0.05 * side));
    ASSERT_TRUE(found);
    const Eigen::Isometry3d off = T_map_lidar.inverse() * *found;
    EXPECT_LT(off.translation().norm(), 0.005);
    EXPECT_LT(maps::rotation_angle_rad(off.linear()), 0.0005);
  }
}

TEST(PointToPlaneReference, AScanBesideTheMapHasNoAnswer) {
  const std::vector<Eigen::Vector3f> scan = the_room().world.scan(pose_at(0, 0), {}).positions;
  EXPECT_FALSE(the_room().reference.align(scan, pose_at(500.0, 0.0)));
}

TEST(PointToPlaneReference, AMapOfAFewPointsIsRefused) {
  EXPECT_THROW(PointToPlaneReference({Eigen::Vector3d::Zero()}), std::invalid_argument);
}

}  // namespace
}  // namespace stillmap::test
