#include "loops/scan_context.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace scan_context_test {

using std::numbers::pi;
using Points = std::vector<Eigen::Vector3f>;

/// In the middle of a bin, so that no rounding moves it to a neighbour.
Eigen::Vector3f in_bin(int ring, int sector, double z) {
  const double range = (ring + 0.5) * kContextReachM / kContextRings;
  const double azimuth = (sector + 0.5) * 2.0 * pi / kContextSectors - pi;
  return Eigen::Vector3d(range * std::cos(azimuth), range * std::sin(azimuth), z).cast<float>();
}

/// Ground in every bin near by, 1.8 m below the sensor.
Points ground() {
  Points points;
  for (int ring = 0; ring < 5; ++ring) {
    for (int sector = 0; sector < kContextSectors; ++sector)
      points.push_back(in_bin(ring, sector, -1.8));
  }
  return points;
}

Points with(Points points, const Points& more) {
  points.insert(points.end(), more.begin(), more.end());
  return points;
}

/// Things of various heights in many bins.
Points things(std::uint64_t seed) {
  test::Random random(seed);
  Points points = ground();
  for (int i = 0; i < 300; ++i)
    points.push_back(in_bin(static_cast<int>(random.uniform(0.0, 20.0)),
                            static_cast<int>(random.uniform(0.0, 60.0)),
                            random.uniform(-1.0, 6.0)));
  return points;
}

Points turned(Points points, double angle_rad) {
  const Eigen::Matrix3d R =
      Eigen::AngleAxisd(angle_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  for (Eigen::Vector3f& p : points) p = (R * p.cast<double>()).cast<float>();
  return points;
}

TEST(ScanContext, HoldsTheHighestPointOfEachBinOverTheGround) {
  const ScanContext context =
      describe(with(ground(), {in_bin(2, 10, 0.2), in_bin(2, 10, 1.2), in_bin(19, 59, 4.2)}));
  EXPECT_NEAR(context.heights_m(2, 10), 3.0F, 1e-5F);
  EXPECT_NEAR(context.heights_m(19, 59), 6.0F, 1e-5F);
  EXPECT_EQ(context.heights_m(2, 11), 0.0F);
  EXPECT_NEAR(context.heights_m.sum(), 9.0F, 1e-4F);
  EXPECT_EQ(context.seen_sectors(), 2);
}

TEST(ScanContext, CountsSectorsFromStraightBackwardsOn) {
  const ScanContext context =
      describe(with(ground(), {{10.0F, 0.1F, 0.0F}, {-10.0F, -0.1F, 1.0F}}));
  EXPECT_NEAR(context.heights_m(2, 30), 1.8F, 1e-5F);
  EXPECT_NEAR(context.heights_m(2, 0), 2.8F, 1e-5F);
}

TEST(ScanContext, SeesNothingBeyondItsReachNorBelowTheGround) {
  const ScanContext context = describe(with(ground(), {{80.1F, 0.0F, 5.0F}, in_bin(8, 3, -6.0)}));
  EXPECT_EQ(context.heights_m.maxCoeff(), 0.0F);
}

TEST(ScanContext, OfAnEmptyScanIsEmptyAndLikeNothing) {
  const ScanContext empty = describe({});
  EXPECT_EQ(empty.heights_m.cwiseAbs().maxCoeff(), 0.0F);
  EXPECT_EQ(empty.seen_sectors(), 0);
  EXPECT_EQ(distance_between(empty, describe(things(1))).distance, 1.0);
  EXPECT_EQ(distance_between(empty, empty).distance, 1.0);
}

TEST(ScanContext, TurnedBySectorsHasItsColumnsShifted) {
  const ScanContext context = describe(things(1));
  for (const int sectors : {0, 1, 17, 30, 59}) {
    const ScanContext other = describe(turned(things(1), sectors * 2.0 * pi / kContextSectors));
    for (int j = 0; j < kContextSectors; ++j) {
      const int to = (j + sectors) % kContextSectors;
      EXPECT_EQ((other.heights_m.col(to) - context.heights_m.col(j)).norm(), 0.0F) << sectors;
    }
    const ContextDistance found = distance_between(context, other);
    EXPECT_NEAR(found.distance, 0.0, 1e-6);
    EXPECT_EQ(found.shift, sectors);
    EXPECT_NEAR((ring_key(other) - ring_key(context)).norm(), 0.0F, 1e-6F);
  }
}

TEST(ScanContext, DoesNotMindTheHeightOfTheMount) {
  Points higher = things(1);
  for (Eigen::Vector3f& p : higher) p.z() -= 1.2F;
  const float difference =
      (describe(higher).heights_m - describe(things(1)).heights_m).cwiseAbs().maxCoeff();
  EXPECT_LT(difference, 1e-5F);
}

TEST(ScanContext, TellsPlacesApart) {
  const ScanContext here = describe(things(1));
  EXPECT_GT(distance_between(here, describe(things(2))).distance, 0.4);
}

TEST(ScanContext, CountsAColumnThatOneAloneHasAsWhollyDifferent) {
  const ScanContext two = describe(with(ground(), {in_bin(6, 0, 1.0), in_bin(9, 20, 1.0)}));
  const ScanContext one = describe(with(ground(), {in_bin(6, 0, 1.0)}));
  const ContextDistance found = distance_between(two, one);
  EXPECT_NEAR(found.distance, 0.5, 1e-6);
  EXPECT_EQ(found.shift, 0);
}

TEST(ScanContext, OfThePlaceDrivenBackIsTurnedByHalfACircle) {
  const test::SyntheticWorld world = test::street(3, 120.0);
  const test::ScanPattern pattern{.rings = 32, .columns = 360};
  const ScanContext there = describe(world.scan(test::pose_at(60.0, 0.0), pattern).positions);
  const ScanContext back = describe(world.scan(test::pose_at(60.3, 0.1, pi), pattern).positions);
  const ScanContext far = describe(world.scan(test::pose_at(20.0, 0.0, pi), pattern).positions);
  const ContextDistance found = distance_between(there, back);
  EXPECT_EQ(found.shift, 30);
  EXPECT_LT(found.distance, 0.7 * distance_between(there, far).distance);
}

}  // namespace scan_context_test
}  // namespace stillmap::mapping
