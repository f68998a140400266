#include "ground/ground_fill.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "support/point_clouds.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace ground_fill_test {

using test::ThrowsSaying;
using ::testing::IsEmpty;
using ::testing::SizeIs;

double slope_at(double x, double y) { return 0.08 * x - 0.01 * y; }

/// A slope that is known over 40 x 40 m around the origin, but for x > 6 where only y < 2 is.
class GroundFill : public ::testing::Test {
 protected:
  GroundFill() {
    std::vector<Eigen::Vector3f> points;
    for (double y = -19.95; y < 20.0; y += 0.2) {
      for (double x = -19.95; x < 20.0; x += 0.2) {
        if (x > 6.0 && y > 2.0) continue;
        points.push_back(Eigen::Vector3d(x, y, slope_at(x, y)).cast<float>());
      }
    }
    ground_.add(reduce_ground(test::cloud_of(points), std::vector<std::uint8_t>(points.size(), 1),
                              {}, Eigen::Isometry3d::Identity()));
    ground_.finish({});
  }

  [[nodiscard]] std::vector<Eigen::Vector3d> fill(
      maps::TileId tile, const std::vector<maps::Box>& removed,
      const std::vector<maps::MapPoint>& points = {}) const {
    std::vector<GroundFootprint> footprints;
    for (const maps::Box& box : removed) footprints.push_back(footprint_of(box));
    const Eigen::Vector3d zero = Eigen::Vector3d::Zero();
    return fill_ground(tile, {zero, zero, points}, footprints, ground_, 0.1);
  }

  [[nodiscard]] static maps::MapPoint point(double x, double y, double height_m,
                                            maps::PointKind kind = maps::PointKind::kGround) {
    return {.x = static_cast<float>(x),
            .y = static_cast<float>(y),
            .z = static_cast<float>(slope_at(x, y) + height_m),
            .intensity = 0.0F,
            .observations = 1,
            .kind = kind,
            .object = 0};
  }

  FusedGround ground_;
};

/// Covers the columns whose middles are at 1.05 to 1.95 m and 2.05 to 2.45 m: 10 x 5.
const maps::Box kSmall = {.centre = {1.5, 2.25, 0.5}, .size_m = {1.0, 0.5, 1.0}};

TEST_F(GroundFill, PutsAPointIntoEachColumnOfAFootprintOnTheGround) {
  const auto points = fill({0, 0, 0}, {kSmall});
  ASSERT_THAT(points, SizeIs(50));
  for (const Eigen::Vector3d& p : points) {
    const Eigen::Vector3d q = p.cast<double>();
    EXPECT_NEAR(q.z(), slope_at(q.x(), q.y()), 0.003);
    EXPECT_NEAR(10.0 * q.x() - std::floor(10.0 * q.x()), 0.5, 1e-4);
  }
  EXPECT_NEAR(points.front().x(), 1.05, 1e-5);
  EXPECT_NEAR(points.front().y(), 2.05, 1e-5);
}

TEST_F(GroundFill, TurnsAFootprintWithItsObject) {
  maps::Box turned = kSmall;
  turned.yaw_rad = 0.5 * 3.14159265358979;
  const auto points = fill({0, 0, 0}, {turned});
  ASSERT_FALSE(points.empty());
  for (const Eigen::Vector3d& p : points) {
    EXPECT_LE(std::abs(p.x() - 1.5F), 0.25F);
    EXPECT_LE(std::abs(p.y() - 2.25F), 0.5F);
  }
}

TEST_F(GroundFill, LeavesWhatHasGroundOrProjectedPointsAndTheirNeighbours) {
  EXPECT_THAT(fill({0, 0, 0}, {kSmall}, {point(1.52, 2.27, 0.0)}), SizeIs(45));
  EXPECT_THAT(fill({0, 0, 0}, {kSmall}, {point(1.52, 2.27, 0.03, maps::PointKind::kProjected)}),
              SizeIs(45));
  // In the corner only two neighbours are in the footprint; outside one reaches in.
  EXPECT_THAT(fill({0, 0, 0}, {kSmall}, {point(1.01, 2.01, 0.0)}), SizeIs(47));
  EXPECT_THAT(fill({0, 0, 0}, {kSmall}, {point(1.55, 1.95, 0.0)}), SizeIs(49));
}

TEST_F(GroundFill, TakesNoPointOffTheGroundNorAnyOtherKindForGround) {
  EXPECT_THAT(fill({0, 0, 0}, {kSmall}, {point(1.52, 2.27, 0.08)}), SizeIs(50));
  EXPECT_THAT(fill({0, 0, 0}, {kSmall}, {point(1.52, 2.27, -0.3)}), SizeIs(50));
  EXPECT_THAT(fill({0, 0, 0}, {kSmall}, {point(1.52, 2.27, 0.0, maps::PointKind::kMeasured)}),
              SizeIs(50));
}

TEST_F(GroundFill, FillsOnlyTheFarHalfOfACarSeenFromOneSide) {
  const maps::Box seen = {.centre = {2.0, 4.0, 0.8}, .size_m = {4.0, 2.0, 1.5}};
  std::vector<maps::MapPoint> near_half;
  for (double y = 3.05; y < 4.0; y += 0.1) {
    for (double x = 0.05; x < 4.0; x += 0.1)
      near_half.push_back(point(x, y, 0.0, maps::PointKind::kProjected));
  }
  const auto points = fill({0, 0, 0}, {seen}, near_half);
  EXPECT_THAT(points, SizeIs(40 * 9));
  for (const Eigen::Vector3d& p : points) EXPECT_GT(p.y(), 4.0);
}

TEST_F(GroundFill, StopsWhereTheGroundIsNotKnownAnyMore) {
  // Ground ends at y = 2; the object lies beyond.
  const maps::Box far = {.centre = {17.9, 11.0, 0.8}, .size_m = {4.0, 17.0, 1.5}};
  const auto points = fill({0, 0, 0}, {far});
  ASSERT_FALSE(points.empty());
  const auto [lowest, highest] = std::minmax_element(
      points.begin(), points.end(), [](const auto& a, const auto& b) { return a.y() < b.y(); });
  EXPECT_NEAR(lowest->y(), 2.55, 0.11);
  EXPECT_GT(highest->y(), 4.0F);
  EXPECT_LT(highest->y(), 8.05F);
}

TEST_F(GroundFill, FillsEachColumnInOneTileAlone) {
  const maps::Box across = {.centre = {0.0, 0.0, 0.5}, .size_m = {2.0, 2.0, 1.0}};
  std::size_t sum = 0;
  for (const int x : {-1, 0}) {
    for (const int y : {-1, 0}) {
      const auto points = fill({0, x, y}, {across});
      for (const Eigen::Vector3d& p : points) {
        EXPECT_EQ(static_cast<int>(std::floor(p.x() / 20.0F)), x);
        EXPECT_EQ(static_cast<int>(std::floor(p.y() / 20.0F)), y);
      }
      sum += points.size();
    }
  }
  EXPECT_EQ(sum, 400U);
  EXPECT_THAT(fill({0, 3, 0}, {across}), IsEmpty());
}

TEST_F(GroundFill, FillsOverlappingFootprintsOnce) {
  EXPECT_THAT(fill({0, 0, 0}, {kSmall, kSmall}), SizeIs(50));
}

TEST_F(GroundFill, OfNothingIsEmpty) {
  EXPECT_THAT(fill({0, 0, 0}, {}), IsEmpty());
  EXPECT_THAT(fill({0, 50, 50}, {{.centre = {1010.0, 1010.0, 0.0}}}), IsEmpty());
}

TEST_F(GroundFill, RefusesOtherLevelsAndVoxelsWithoutSize) {
  EXPECT_THAT(
      [&] {
        (void)fill({1, 0, 0}, {kSmall});
      },
      ThrowsSaying<std::invalid_argument>({"level 1"}));
  for (const double voxel_m : {0.0, -0.1, std::nan("")}) {
    EXPECT_THAT(
        [&] {
          (void)fill_ground({0, 0, 0}, {}, {}, ground_, voxel_m);
        },
        ThrowsSaying<std::invalid_argument>({"voxel"}));
  }
}

}  // namespace ground_fill_test
}  // namespace stillmap::mapping
