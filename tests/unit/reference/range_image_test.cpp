#include "reference/range_image.hpp"

#include "support/synthetic_world.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace stillmap::mapping {
namespace range_image_test {

constexpr double kDeg = std::numbers::pi / 180.0;

Spherical at(double azimuth_deg, double elevation_deg, double range_m) {
  return {static_cast<float>(azimuth_deg * kDeg), static_cast<float>(elevation_deg * kDeg),
          static_cast<float>(range_m)};
}

TEST(RangeImage, KeepsTheNearestRangeOfAPixel) {
  const RangeImage image({at(10.5, 0.5, 7.0), at(10.6, 0.4, 5.0), at(10.4, 0.6, 6.0)}, kDeg);
  EXPECT_EQ(image.columns(), 360);
  EXPECT_EQ(image.rows(), 1);
  const int pixel = image.pixel_of(at(10.5, 0.5, 1.0));
  EXPECT_FLOAT_EQ(image.nearest_m()[static_cast<std::size_t>(pixel)], 5.0F);
  double sum = 0.0;
  for (const float range_m : image.nearest_m()) sum += static_cast<double>(range_m);
  EXPECT_DOUBLE_EQ(sum, 5.0);
}

TEST(RangeImage, HasRowsFromTheLowestToTheHighestPoint) {
  const RangeImage image({at(0.0, -24.5, 7.0), at(90.0, 2.5, 5.0)}, kDeg);
  EXPECT_EQ(image.rows(), 28);
  EXPECT_EQ(image.pixel_of(at(0.0, -25.5, 1.0)), -1);
  EXPECT_EQ(image.pixel_of(at(0.0, 3.5, 1.0)), -1);
  EXPECT_GE(image.pixel_of(at(0.0, -24.9, 1.0)), 0);
}

TEST(RangeImage, HoldsEveryDirectionAllAround) {
  const RangeImage image({at(-180.0, 0.5, 3.0), at(180.0, 0.5, 4.0)}, kDeg);
  EXPECT_EQ(image.pixel_of(at(-180.0, 0.5, 1.0)), 0);
  EXPECT_EQ(image.pixel_of(at(180.0, 0.5, 1.0)), 359);
}

TEST(RangeImage, WithoutPointsHasNoPixels) {
  const RangeImage image({}, kDeg);
  EXPECT_EQ(image.pixel_of(at(0.0, 0.0, 1.0)), -1);
  EXPECT_EQ(image.farthest_behind({5.0F, 0.0F, 0.0F}, {1.0F, 1.0F, 1.0F}), 0.0F);
}

TEST(RangeImage, RefusesPixelsThatAreNone) {
  EXPECT_THROW(RangeImage({}, 0.0), std::invalid_argument);
  EXPECT_THROW(RangeImage({}, 1.0), std::invalid_argument);
  EXPECT_THROW(RangeImage({}, std::nan("")), std::invalid_argument);
}

TEST(RangeImage, BoundsWhatLiesBehindABox) {
  test::Random random(8);
  std::vector<Spherical> scan;
  for (int i = 0; i < 3000; ++i) {
    scan.push_back(
        at(random.uniform(-180.0, 180.0), random.uniform(-25.0, 25.0), random.uniform(2.0, 60.0)));
  }
  const RangeImage image(scan, 0.7 * kDeg);
  const auto vector = [&random](double x, double y, double z) -> Eigen::Vector3f {
    return Eigen::Vector3d(random.uniform(-x, x), random.uniform(-y, y), random.uniform(-z, z))
        .cast<float>();
  };
  for (int i = 0; i < 4000; ++i) {
    const Eigen::Vector3f centre = vector(20.0, 20.0, 6.0);
    const Eigen::Vector3f half_edge = vector(1.5, 1.5, 1.5).cwiseAbs();
    const float bound_m = image.farthest_behind(centre, half_edge);
    for (int k = 0; k < 20; ++k) {
      const Eigen::Vector3f inside = centre + half_edge.cwiseProduct(vector(1.0, 1.0, 1.0));
      const int pixel = image.pixel_of(spherical_of(inside));
      if (pixel < 0) continue;
      EXPECT_LE(image.nearest_m()[static_cast<std::size_t>(pixel)], bound_m);
    }
  }
}

TEST(RangeImage, KnowsWhatLiesBehindAFlatBox) {
  // A floor all around: a flat patch of it hides no more than the next rows.
  std::vector<Spherical> floor;
  for (int azimuth = 0; azimuth < 360; ++azimuth) {
    for (int elevation = 2; elevation < 45; ++elevation) {
      floor.push_back(
          at(azimuth - 179.5, -elevation - 0.5, 1.8 / std::sin((elevation + 0.5) * kDeg)));
    }
  }
  const RangeImage image(floor, kDeg);
  EXPECT_LT(image.farthest_behind({7.0F, 7.0F, -1.8F}, {0.5F, 0.5F, 0.01F}), 13.5F);
  EXPECT_FLOAT_EQ(image.farthest_m(), static_cast<float>(1.8 / std::sin(2.5 * kDeg)));
}

TEST(RingSpacing, IsFoundFromWhatTheScanSees) {
  for (const int rings : {16, 32, 64}) {
    test::ScanPattern pattern;
    pattern.rings = rings;
    pattern.columns = 900;
    pattern.lowest_rad = -25.0 * kDeg;
    pattern.highest_rad = 15.0 * kDeg;
    std::vector<Spherical> directions;
    for (const Eigen::Vector3f& p : test::room().scan(test::pose_at(0, 0), pattern).positions) {
      directions.push_back(spherical_of(p));
    }
    EXPECT_NEAR(ring_spacing_rad(directions), 40.0 * kDeg / (rings - 1), 0.01 * kDeg);
  }
}

TEST(RingSpacing, IsThatOfAnHdl64WithoutRings) {
  EXPECT_DOUBLE_EQ(ring_spacing_rad({}), 0.4 * kDeg);
  EXPECT_DOUBLE_EQ(ring_spacing_rad({at(0, 0, 1), at(0, 2, 1)}), 0.4 * kDeg);
}

}  // namespace range_image_test
}  // namespace stillmap::mapping
