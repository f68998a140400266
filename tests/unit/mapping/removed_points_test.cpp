#include "evaluation/labels/removed_points.hpp"

#include <gtest/gtest.h>

#include <map>

#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace removed_points_test {

std::map<int, int> met_by_tag(const RemovedPoints& removed) {
  std::map<int, int> met;
  for (const RemovedPoints::Point& point : removed.points()) met[point.tag] = point.met;
  return met;
}

TEST(RemovedPoints, MeetWhatIsWithinFiveAndTenCentimetres) {
  RemovedPoints removed;
  removed.add({0.0F, 0.0F, 0.0F}, 1);
  removed.add({0.07F, 0.0F, 0.0F}, 2);
  removed.add({0.0F, 0.0F, 0.0999F}, 3);
  removed.add({0.0F, -0.1001F, 0.0F}, 4);
  removed.add({9.0F, 9.0F, 9.0F}, 5);
  removed.sort();
  removed.meet({0.0F, 0.0F, 0.0F}, true);
  EXPECT_EQ(met_by_tag(removed),
            (std::map<int, int>{{1, RemovedPoints::kAll},
                                {2, RemovedPoints::kMeasuredNear | RemovedPoints::kAnyNear},
                                {3, RemovedPoints::kMeasuredNear | RemovedPoints::kAnyNear},
                                {4, 0},
                                {5, 0}}));
}

TEST(RemovedPoints, TellMeasuredFromMovedPoints) {
  RemovedPoints removed;
  removed.add({-3.02F, 0.0F, 0.0F}, 1);
  removed.sort();
  removed.meet({-3.0F, 0.0F, 0.0F}, false);
  EXPECT_EQ(removed.points()[0].met, RemovedPoints::kAnySame | RemovedPoints::kAnyNear);
  removed.meet({-3.0F, 0.0F, 0.09F}, true);
  EXPECT_EQ(removed.points()[0].met,
            RemovedPoints::kAnySame | RemovedPoints::kAnyNear | RemovedPoints::kMeasuredNear);
}

/// @param removed_points, map_points  as many, at random places.
void expect_all_pairs(std::size_t removed_points, int map_points) {
  test::Random random(3);
  const auto point = [&]() -> Eigen::Vector3f {
    return Eigen::Vector3d(random.uniform(-0.7, 0.7), random.uniform(-0.7, 0.7),
                           random.uniform(-0.4, 0.4))
        .cast<float>();
  };
  RemovedPoints removed;
  std::vector<Eigen::Vector3f> positions(removed_points);
  std::map<int, int> expected;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    positions[i] = point();
    removed.add(positions[i], static_cast<std::uint16_t>(i));
    expected[static_cast<int>(i)] = 0;
  }
  removed.sort();
  for (int k = 0; k < map_points; ++k) {
    const Eigen::Vector3f map_point = point();
    const bool measured = k % 3 != 0;
    removed.meet(map_point, measured);
    for (std::size_t i = 0; i < positions.size(); ++i) {
      const double distance = (positions[i].cast<double>() - map_point.cast<double>()).norm();
      int& met = expected[static_cast<int>(i)];
      if (distance <= 0.05) met |= RemovedPoints::kAnySame;
      if (distance <= 0.1) met |= RemovedPoints::kAnyNear;
      if (distance <= 0.05 && measured) met |= RemovedPoints::kMeasuredSame;
      if (distance <= 0.1 && measured) met |= RemovedPoints::kMeasuredNear;
    }
  }
  EXPECT_EQ(met_by_tag(removed), expected);
}

TEST(RemovedPoints, MeetTheSameAsWhenAllPairsAreCompared) {
  expect_all_pairs(2000, 60);
  // So few that most of the map is out of reach of all of them.
  expect_all_pairs(12, 3000);
}

TEST(RemovedPoints, MayBeNone) {
  RemovedPoints removed;
  removed.sort();
  removed.meet({0.0F, 0.0F, 0.0F}, true);
  EXPECT_TRUE(removed.points().empty());
}

}  // namespace removed_points_test
}  // namespace stillmap::mapping
