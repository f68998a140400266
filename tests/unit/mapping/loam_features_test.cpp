#include "odometry/loam/features.hpp"

#include "support/synthetic_world.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <tuple>

namespace stillmap::mapping::loam {
namespace loam_features_test {

using Ring = std::vector<Eigen::Vector3f>;

/// 200 beams of 0.4 degrees from -40 to 40 degrees; `range(azimuth)` in metres.
template <typename Range>
Ring ring_of(const Range& range) {
  Ring ring;
  for (int k = -100; k < 100; ++k) {
    const double a = 0.4 * k * std::numbers::pi / 180.0;
    const double range_m = range(a);
    ring.emplace_back((range_m * Eigen::Vector3d(std::cos(a), std::sin(a), 0.0)).cast<float>());
  }
  return ring;
}

TEST(LoamSmoothness, IsEquationOneByHand) {
  // Eleven points of a straight line, evenly apart: the differences cancel.
  Ring line;
  for (int k = -5; k <= 5; ++k) line.emplace_back(10.0F, 0.1F * static_cast<float>(k), 0.0F);
  EXPECT_NEAR(smoothness(line)[5], 0.0, 1e-7);
  // A right angle whose sides go 0.1 m a point from (10, 0): the sum is -(0.1 + ... + 0.5) = -1.5 m
  // along each of the two sides, over 10 points and 10 m.
  Ring corner;
  for (int k = 5; k >= 1; --k)
    corner.emplace_back(10.0F + 0.1F * static_cast<float>(k), 0.0F, 0.0F);
  corner.emplace_back(10.0F, 0.0F, 0.0F);
  for (int k = 1; k <= 5; ++k) corner.emplace_back(10.0F, 0.1F * static_cast<float>(k), 0.0F);
  EXPECT_NEAR(smoothness(corner)[5], 1.5 * std::sqrt(2.0) / (10.0 * 10.0), 1e-6);
  for (const std::size_t k : {0U, 4U, 6U, 10U}) EXPECT_TRUE(std::isnan(smoothness(corner)[k]));
}

TEST(LoamReliable, LeavesOutWhatAnotherThingHides) {
  // A post at 5 m before a wall at 10 m: the wall's points beside it end at its shadow, not at an
  // edge; the post's own points are good.
  const Ring ring = ring_of([](double a) { return std::abs(a) < 0.04 ? 5.0 : 10.0 / std::cos(a); });
  const auto good = reliable(ring);
  for (std::size_t k = 0; k < ring.size(); ++k) {
    const bool post = ring[k].norm() < 6.0F;
    const auto from_post =
        std::min<int>(std::abs(static_cast<int>(k) - 95), std::abs(static_cast<int>(k) - 105));
    if (post || from_post > 7) {
      EXPECT_EQ(good[k], 1) << k;
    } else if (from_post <= 5) {
      EXPECT_EQ(good[k], 0) << k;
    }
  }
}

TEST(LoamReliable, LeavesOutSurfacesNearlyParallelToTheBeam) {
  // A wall at y = 2 m ends at 40 degrees of azimuth; at 6 degrees the beam meets it at 6 degrees.
  const Ring ring = ring_of([](double a) { return a > 0.05 ? 2.0 / std::sin(a) : 30.0; });
  const auto good = reliable(ring);
  EXPECT_EQ(good[100 + 18], 0);  // 7.2 degrees
  EXPECT_EQ(good[100 + 75], 1);  // 30 degrees
}

TEST(LoamFeatures, AreAtMostTwoEdgesAndFourPlanesASector) {
  const test::SyntheticWorld world = test::street(7);
  test::ScanPattern pattern;
  pattern.columns = 1800;
  pattern.noise_m = 0.02;
  maps::Scan scan;
  scan.cloud = world.scan(test::pose_at(50.0, 0.0), pattern);
  const Rings rings = find_rings(scan);
  const Features features = find_features(scan.cloud, rings);
  const std::size_t sectors = kSectors * rings.size();
  EXPECT_GT(features.edges.size(), sectors / 8);
  EXPECT_GT(features.planes.size(), sectors);
  EXPECT_GT(features.less_sharp.size(), features.edges.size());
  EXPECT_GT(features.less_flat.size(), features.planes.size());
  std::map<std::tuple<int, float, float>, std::size_t> place;
  for (std::size_t r = 0; r < rings.size(); ++r) {
    for (std::size_t k = 0; k < rings.ring(r).size(); ++k) {
      const auto& p = scan.cloud.positions[rings.ring(r)[k]];
      place[{static_cast<int>(r), p.x(), p.y()}] = k;
    }
  }
  const auto most = [&](const std::vector<Feature>& found) {
    std::map<std::pair<std::size_t, std::size_t>, std::size_t> counts;
    std::size_t largest = 0;
    for (const Feature& f : found) {
      const std::size_t k =
          place.at({static_cast<int>(f.ring), f.position.x(), f.position.y()}) - kNeighbours;
      const std::size_t known = rings.ring(f.ring).size() - 2 * kNeighbours;
      std::size_t sector = 0;
      while (k >= known * (sector + 1) / kSectors) ++sector;
      largest = std::max(largest, ++counts[{f.ring, sector}]);
    }
    return largest;
  };
  EXPECT_EQ(most(features.edges), kEdgesPerSector);
  EXPECT_EQ(most(features.planes), kPlanesPerSector);
  EXPECT_LE(most(features.less_sharp), kLessSharpPerSector);
}

TEST(LoamFeatures, FindTheCornersOfARoom) {
  test::SyntheticWorld hall = test::room();
  hall.boxes.resize(4);
  hall.cylinders.clear();
  test::ScanPattern pattern;
  pattern.columns = 1800;
  pattern.lowest_rad = -0.05;
  pattern.highest_rad = 0.05;
  maps::Scan scan;
  scan.cloud = hall.scan(test::pose_at(-2.0, 0.5), pattern);
  const Features features = find_features(scan.cloud, find_rings(scan));
  int near_corner = 0;
  for (const Feature& f : features.edges) {
    const Eigen::Vector2d p = f.position.head<2>().cast<double>() + Eigen::Vector2d(-2.0, 0.5);
    near_corner += (p.cwiseAbs() - Eigen::Vector2d(15.0, 10.0)).norm() < 0.15 ? 1 : 0;
  }
  EXPECT_GE(near_corner, 3 * pattern.rings);
  EXPECT_GT(10 * near_corner, 9 * static_cast<int>(features.edges.size()));
}

TEST(LoamFeatures, OfNothingAreNone) {
  const Features features = find_features({}, {});
  EXPECT_TRUE(features.edges.empty());
  EXPECT_TRUE(features.less_flat.empty());
}

}  // namespace loam_features_test
}  // namespace stillmap::mapping::loam
