#include "reference/polar_bins.hpp"

#include "reference/region_ground.hpp"
#include "support/synthetic_world.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace stillmap::mapping {
namespace polar_bins_test {

Eigen::Vector3f polar(double range_m, double azimuth_deg, double z_m) {
  const double azimuth = azimuth_deg * std::numbers::pi / 180.0;
  return Eigen::Vector3d(range_m * std::cos(azimuth), range_m * std::sin(azimuth), z_m)
      .cast<float>();
}

TEST(PolarBins, AreRingsOfFourMetresAndSectorsOfThreeAndAThirdDegrees) {
  const int bin = PolarBins::bin_of(polar(5.0, 1.0, 0.0));
  EXPECT_EQ(PolarBins::bin_of(polar(7.9, 3.3, 2.9)), bin);
  EXPECT_NE(PolarBins::bin_of(polar(8.1, 1.0, 0.0)), bin);
  EXPECT_NE(PolarBins::bin_of(polar(5.0, 3.4, 0.0)), bin);
  EXPECT_NE(PolarBins::bin_of(polar(5.0, -0.1, 0.0)), bin);
  EXPECT_EQ(PolarBins::bin_of(polar(9.0, 1.0, 0.0)) - bin, PolarBins::kSectors);
}

TEST(PolarBins, EndAtTheVolumeOfInterest) {
  EXPECT_GE(PolarBins::bin_of(polar(79.9, 180.0, 0.0)), 0);
  EXPECT_EQ(PolarBins::bin_of(polar(80.1, 180.0, 0.0)), -1);
  EXPECT_EQ(PolarBins::bin_of(polar(10.0, 0.0, 3.01)), -1);
  EXPECT_EQ(PolarBins::bin_of(polar(10.0, 0.0, -1.31)), -1);
  EXPECT_LT(PolarBins::bin_of(polar(80.0, -180.0, 0.0)), static_cast<int>(PolarBins::kBins));
}

TEST(PolarBins, ASphereTouchesEveryBinItHoldsAPointOf) {
  test::Random random(5);
  for (int i = 0; i < 3000; ++i) {
    const Eigen::Vector3f centre =
        polar(random.uniform(0.0, 85.0), random.uniform(-180.0, 180.0), random.uniform(-2.0, 4.0));
    const auto radius_m = static_cast<float>(random.uniform(0.1, 3.0));
    const Eigen::Vector3d unit =
        Eigen::Vector3d(random.normal(), random.normal(), random.normal()).normalized();
    const int bin = PolarBins::bin_of(centre + 0.999F * radius_m * unit.cast<float>());
    if (bin < 0) continue;
    std::array<std::uint8_t, PolarBins::kBins> flags{};
    flags[static_cast<std::size_t>(bin)] = 1;
    EXPECT_TRUE(PolarBins::touches(centre, radius_m, flags)) << centre.transpose();
  }
}

TEST(PolarBins, AFarSphereTouchesNoOtherBin) {
  std::array<std::uint8_t, PolarBins::kBins> flags{};
  flags[static_cast<std::size_t>(PolarBins::bin_of(polar(30.0, 45.0, 0.0)))] = 1;
  EXPECT_TRUE(PolarBins::touches(polar(30.0, 46.0, 0.0), 0.5F, flags));
  EXPECT_FALSE(PolarBins::touches(polar(30.0, 60.0, 0.0), 0.5F, flags));
  EXPECT_FALSE(PolarBins::touches(polar(40.0, 45.0, 0.0), 0.5F, flags));
  EXPECT_FALSE(PolarBins::touches(polar(30.0, 45.0, 9.0), 0.5F, flags));
}

TEST(ScanRatio, IsTheSmallerPseudoOccupancyOverTheLarger) {
  PseudoOccupancy map;
  PseudoOccupancy scan;
  for (const float z : {0.0F, 1.5F, 0.7F}) map.add(z);
  for (const float z : {-0.1F, 0.2F}) scan.add(z);
  EXPECT_FLOAT_EQ(map.height_m(), 1.5F);
  EXPECT_FLOAT_EQ(scan.height_m(), 0.3F);
  EXPECT_FLOAT_EQ(scan_ratio(map, scan), 0.2F);
  EXPECT_FLOAT_EQ(scan_ratio(scan, map), 0.2F);
}

TEST(ScanRatio, SaysNothingOfTwoFlatBins) {
  PseudoOccupancy flat;
  flat.add(1.0F);
  EXPECT_FALSE(scan_ratio(flat, flat) < 0.2F);
  EXPECT_EQ(PseudoOccupancy{}.height_m(), 0.0F);
}

/// A slope of 10 % with a box of 1 x 1 x 1.5 m on it.
std::vector<Eigen::Vector3f> slope_with_box(std::size_t& ground_points) {
  std::vector<Eigen::Vector3f> points;
  const auto add = [&points](double x, double y, double z) {
    points.emplace_back(Eigen::Vector3d(x, y, z).cast<float>());
  };
  for (int x = 0; x < 40; ++x) {
    for (int y = 0; y < 40; ++y) add(0.1 * x, 0.1 * y, 0.01 * x);
  }
  ground_points = points.size();
  for (int z = 3; z < 15; ++z) {
    for (int y = 0; y < 10; ++y) add(2.0, 1.0 + 0.1 * y, 0.2 + 0.1 * z);
  }
  return points;
}

TEST(RegionGround, KeepsASlopeAndDropsWhatStandsOnIt) {
  std::size_t ground_points = 0;
  const std::vector<Eigen::Vector3f> points = slope_with_box(ground_points);
  const std::vector<std::uint8_t> is_ground = region_ground(points);
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(is_ground[i] != 0, i < ground_points) << points[i].transpose();
  }
}

TEST(RegionGround, IsTheSameInAnyOrder) {
  std::size_t ground_points = 0;
  std::vector<Eigen::Vector3f> points = slope_with_box(ground_points);
  const std::vector<std::uint8_t> forward = region_ground(points);
  std::reverse(points.begin(), points.end());
  std::vector<std::uint8_t> backward = region_ground(points);
  std::reverse(backward.begin(), backward.end());
  EXPECT_EQ(forward, backward);
}

TEST(RegionGround, OfLessThanAPlaneIsNothing) {
  EXPECT_TRUE(region_ground({}).empty());
  EXPECT_EQ(region_ground({{0, 0, 0}, {1, 0, 0}}), (std::vector<std::uint8_t>{0, 0}));
}

}  // namespace polar_bins_test
}  // namespace stillmap::mapping
