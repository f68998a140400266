#include "ground/fused_ground.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <numbers>

#include "ground/ground_cells.hpp"
#include "support/point_clouds.hpp"
#include "support/synthetic_world.hpp"
#include "support/throws.hpp"

namespace stillmap::mapping {
namespace fused_ground_test {

using test::ThrowsSaying;

using Height = std::function<double(double x, double y)>;
using Keep = std::function<bool(double x, double y)>;

const Keep kEverywhere = [](double, double) { return true; };

/// Ground every 0.1 m over 24 x 16 m around the origin, seen from a sensor at the origin; the
/// lidar frame is the local frame.
struct Ground {
  std::vector<Eigen::Vector3f> points;

  void lay(const Height& height, const Keep& keep = kEverywhere) {
    for (int iy = -80; iy < 80; ++iy) {
      for (int ix = -120; ix < 120; ++ix) {
        const double x = 0.1 * ix + 0.03;
        const double y = 0.1 * iy + 0.04;
        if (keep(x, y)) points.push_back(Eigen::Vector3d(x, y, height(x, y)).cast<float>());
      }
    }
  }
  [[nodiscard]] GroundCells cells(const std::vector<maps::Box>& boxes = {}) const {
    return reduce_ground(test::cloud_of(points), std::vector<std::uint8_t>(points.size(), 1), boxes,
                         Eigen::Isometry3d::Identity());
  }
};

FusedGround fused(const std::vector<GroundCells>& scans,
                  const std::vector<GroundFootprint>& footprints = {}) {
  FusedGround ground;
  for (const GroundCells& scan : scans) ground.add(scan);
  ground.finish(footprints);
  return ground;
}

FusedGround fused(const Height& height, const Keep& keep = kEverywhere,
                  const std::vector<maps::Box>& footprints = {}) {
  Ground ground;
  ground.lay(height, keep);
  std::vector<GroundFootprint> feet;
  for (const maps::Box& box : footprints) feet.push_back(footprint_of(box));
  return fused({ground.cells()}, feet);
}

double z_at(const FusedGround& ground, double x, double y) {
  const auto sample = ground.at(x, y);
  return sample ? sample->z : std::numeric_limits<double>::quiet_NaN();
}

/// Largest error over a rectangle [m]; NaN where nothing is known, which no bound lets pass.
double worst(const FusedGround& ground, const Height& height, const Eigen::AlignedBox2d& where,
             const Keep& keep = kEverywhere) {
  double error = 0.0;
  for (double y = where.min().y(); y <= where.max().y(); y += 0.07) {
    for (double x = where.min().x(); x <= where.max().x(); x += 0.07) {
      if (!keep(x, y)) continue;
      const double off = std::abs(z_at(ground, x, y) - height(x, y));
      if (!(off <= error)) error = off;
    }
  }
  return error;
}

Eigen::AlignedBox2d around(double x, double y, double half_x, double half_y) {
  return {Eigen::Vector2d(x - half_x, y - half_y), Eigen::Vector2d(x + half_x, y + half_y)};
}

/// A car 4.5 m long and 1.8 m wide at the origin, and what no ray reached below it.
const maps::Box kCar = {.centre = {0.0, 0.0, 0.8}, .size_m = {4.5, 1.8, 1.5}};
const Keep kBesideCar = [](double x, double y) {
  return !(std::abs(x) < 2.25 && std::abs(y) < 0.9);
};
double kerb_at(double y, double kerb_y) { return y > kerb_y ? 0.12 : 0.0; }

TEST(FusedGround, FollowsASlopeExactlyWithItsNormal) {
  const Height slope = [](double x, double y) { return 0.08 * x - 0.03 * y + 5.0; };
  const FusedGround ground = fused(slope);
  EXPECT_LT(worst(ground, slope, around(0.0, 0.0, 11.5, 7.5)), 0.002);
  const auto sample = ground.at(1.0, 1.0);
  ASSERT_TRUE(sample);
  EXPECT_LT((sample->normal - Eigen::Vector3d(-0.08, 0.03, 1.0).normalized()).norm(), 0.002);
  EXPECT_GT(sample->confidence, 0.9);
}

TEST(FusedGround, FollowsAHill) {
  const Height hill = [](double x, double y) {
    return std::sin(0.25 * x) + 0.3 * std::cos(0.3 * y);
  };
  EXPECT_LT(worst(fused(hill), hill, around(0.0, 0.0, 11.5, 7.5)), 0.01);
}

TEST(FusedGround, KeepsAKerbAStepOfItsFullHeight) {
  const Height kerb = [](double, double y) { return kerb_at(y, 1.0); };
  const Keep off_the_kerb = [](double, double y) { return std::abs(y - 1.0) > 0.03; };
  EXPECT_LT(worst(fused(kerb), kerb, around(0.0, 1.0, 8.0, 2.0), off_the_kerb), 0.005);
}

TEST(FusedGround, KeepsAKerbThatRunsAcrossTheCellsSharpToOneCell) {
  const Height kerb = [](double x, double y) { return kerb_at(y, 0.4 * x + 0.1); };
  const Keep off_the_kerb = [](double x, double y) { return std::abs(y - 0.4 * x - 0.1) > 0.4; };
  EXPECT_LT(worst(fused(kerb), kerb, around(0.0, 0.0, 8.0, 5.0), off_the_kerb), 0.01);
}

TEST(FusedGround, SpansAHoleInASlope) {
  const Height slope = [](double x, double y) { return 0.08 * x + 0.02 * y; };
  const FusedGround ground = fused(slope, kBesideCar);
  EXPECT_LT(worst(ground, slope, around(0.0, 0.0, 2.3, 1.0)), 0.003);
  const auto middle = ground.at(0.0, 0.0);
  ASSERT_TRUE(middle);
  EXPECT_LT(middle->confidence, ground.at(0.0, 4.0)->confidence);
  EXPECT_GT(middle->confidence, 0.3);
}

TEST(FusedGround, GoesOnAsASlopeWhereOnlyOneSideWasSeen) {
  const Height slope = [](double, double y) { return 0.08 * y; };
  const Keep one_side = [](double, double y) { return y < 0.0; };
  const FusedGround ground = fused(slope, one_side);
  EXPECT_LT(worst(ground, slope, around(0.0, 0.0, 6.0, 2.0)), 0.01);
  EXPECT_FALSE(ground.at(0.0, 4.0));
}

TEST(FusedGround, ContinuesAKerbUnderACarThatStraddlesIt) {
  for (const double kerb_y : {0.0, 0.25, -0.5}) {
    const Height kerb = [&](double x, double y) { return 0.05 * x + kerb_at(y, kerb_y); };
    const Keep off_the_kerb = [&](double, double y) { return std::abs(y - kerb_y) > 0.26; };
    const FusedGround ground = fused(kerb, kBesideCar, {kCar});
    EXPECT_LT(worst(ground, kerb, around(0.0, 0.0, 2.3, 1.0), off_the_kerb), 0.015) << kerb_y;
    EXPECT_LT(worst(ground, kerb, around(0.0, 0.0, 2.3, 1.0)), 0.10) << kerb_y;
  }
}

TEST(FusedGround, PutsAKerbThatWasNotSeenBesideTheObject) {
  // The ground is hidden ahead of and behind the car too: only road and pavement are seen.
  const Height kerb = [](double, double y) { return kerb_at(y, 1.1); };
  const Keep hidden = [](double, double y) { return std::abs(y) > 1.4; };
  const FusedGround ground = fused(kerb, hidden, {kCar});
  EXPECT_LT(worst(ground, kerb, around(0.0, 0.0, 2.2, 0.85)), 0.01);
}

TEST(FusedGround, DropsABonnetThatWasLabelledGround) {
  const Height road = [](double, double) { return 0.0; };
  Ground seen;
  seen.lay(road, kBesideCar);
  seen.lay([](double, double) { return 0.8; },
           [](double x, double y) { return x > 1.0 && x < 2.2 && std::abs(y) < 0.7; });
  EXPECT_LT(worst(fused({seen.cells()}), road, around(0.0, 0.0, 3.0, 2.0)), 0.003);
}

TEST(FusedGround, KeepsATrafficIsland) {
  const Height island = [](double x, double y) {
    return std::abs(x) < 0.9 && std::abs(y) < 0.9 ? 0.12 : 0.0;
  };
  EXPECT_NEAR(z_at(fused(island), 0.0, 0.0), 0.12, 0.005);
}

TEST(FusedGround, DropsMirrorImagesBelowTheRoad) {
  const Height road = [](double, double) { return 0.0; };
  Ground seen;
  seen.lay(road);
  Ground mirrored = seen;
  mirrored.lay([](double, double) { return -0.9; },
               [](double x, double y) { return std::abs(x) < 1.0 && std::abs(y) < 0.6; });
  EXPECT_LT(worst(fused({mirrored.cells(), seen.cells(), seen.cells()}), road,
                  around(0.0, 0.0, 6.0, 5.0)),
            0.003);
}

TEST(FusedGround, TakesGroundUnderACarAndLeavesItsTyres) {
  const Height road = [](double x, double) { return 0.02 * x; };
  const Keep under = [](double x, double y) { return std::abs(x) < 1.0 && std::abs(y) < 0.9; };
  const Keep tyre = [](double x, double y) {
    return std::abs(x - 1.6) < 0.3 && std::abs(y + 0.7) < 0.12;
  };
  Ground seen;
  seen.lay(road, kBesideCar);
  seen.lay(road, under);
  seen.lay([&](double x, double y) { return road(x, y) + 0.12; }, tyre);
  const FusedGround ground = fused({seen.cells({kCar})}, {footprint_of(kCar)});
  EXPECT_LT(worst(ground, road, around(0.0, 0.0, 2.3, 1.0)), 0.01);
  const auto place = ground.sheets().find(0, 0, std::nullopt);
  ASSERT_TRUE(place);
  EXPECT_EQ(ground.sheets().node(*place).state, GroundState::kKnown);
}

TEST(FusedGround, BelievesNearPointsMoreThanFarOnes) {
  // Five scans from 60 m away see the road 7 cm too high, one from above sees it right.
  const Height road = [](double, double) { return 0.0; };
  Ground near;
  near.lay(road);
  Eigen::Isometry3d T_local_lidar = Eigen::Isometry3d::Identity();
  T_local_lidar.translation() = Eigen::Vector3d(-60.0, 0.0, 0.07);
  std::vector<Eigen::Vector3f> far = near.points;
  for (Eigen::Vector3f& p : far) p.x() += 60.0F;
  const GroundCells high = reduce_ground(
      test::cloud_of(far), std::vector<std::uint8_t>(far.size(), 1), {}, T_local_lidar);
  const FusedGround ground = fused({high, high, near.cells(), high, high, high});
  EXPECT_LT(worst(ground, road, around(0.0, 0.0, 6.0, 5.0)), 0.015);
}

TEST(FusedGround, KeepsARoadAndTheBridgeOverItApart) {
  const Height road = [](double, double) { return 0.0; };
  const Height bridge = [](double x, double) { return 5.0 + 0.02 * x; };
  const Keep deck = [](double, double y) { return std::abs(y) < 3.0; };
  Ground below, above;
  below.lay(road);
  above.lay(bridge, deck);
  const FusedGround ground = fused({below.cells(), above.cells(), above.cells()});
  for (const double x : {-8.0, 0.0, 7.3}) {
    ASSERT_TRUE(ground.at(x, 0.0, 1.5));
    // A car under the bridge, one on it, and one whose tyres sank in.
    EXPECT_NEAR(ground.at(x, 0.0, 1.5)->z, 0.0, 0.005);
    EXPECT_NEAR(ground.at(x, 0.0, 6.0)->z, bridge(x, 0.0), 0.005);
    EXPECT_NEAR(ground.at(x, 0.0, bridge(x, 0.0) - 0.2)->z, bridge(x, 0.0), 0.005);
    EXPECT_NEAR(ground.at(x, 0.0, -3.0)->z, 0.0, 0.005);
  }
  // Without a height: what was seen best, here the deck.
  EXPECT_NEAR(z_at(ground, 0.0, 0.0), 5.0, 0.01);
  EXPECT_NEAR(z_at(ground, 0.0, 6.0), 0.0, 0.005);
}

TEST(FusedGround, GoesOverARetainingWall) {
  const Height wall = [](double, double y) { return y > 1.0 ? 3.0 : 0.0; };
  const Keep off_the_wall = [](double, double y) { return std::abs(y - 1.0) > 0.03; };
  EXPECT_LT(worst(fused(wall), wall, around(0.0, 1.0, 8.0, 4.0), off_the_wall), 0.005);
}

TEST(FusedGround, IsUnknownWithoutGroundFarFromItAndForWhatIsNoPlace) {
  const FusedGround nothing = fused(std::vector<GroundCells>{});
  EXPECT_FALSE(nothing.at(0.0, 0.0));
  const FusedGround ground = fused([](double, double) { return 0.0; });
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(ground.at(40.0, 0.0));
  EXPECT_FALSE(ground.at(nan, 0.0));
  EXPECT_FALSE(ground.at(0.0, nan));
  EXPECT_FALSE(ground.at(1e12, 0.0));
  EXPECT_FALSE(FusedGround().at(0.0, 0.0));
}

TEST(FusedGround, SurvivesALoneCellAndFootprintsWithoutGround) {
  GroundCells lone;
  lone.cells.push_back({.x = 3, .y = -2, .z = 1.5F, .weight = 1.0F});
  const FusedGround ground =
      fused({lone}, {footprint_of(kCar), footprint_of({.centre = {500, 0, 0}})});
  EXPECT_NEAR(z_at(ground, 0.875, -0.375), 1.5, 1e-6);
  EXPECT_FALSE(ground.at(500.0, 0.0));
}

TEST(FusedGround, DoesNotDependOnTheOrderOfAScansPoints) {
  Ground seen;
  test::Random random(7);
  seen.lay([&](double x, double) { return 0.03 * x + 0.01 * random.normal(); });
  Ground reversed;
  reversed.points.assign(seen.points.rbegin(), seen.points.rend());
  const GroundCells a = seen.cells();
  const GroundCells b = reversed.cells();
  ASSERT_EQ(a.cells.size(), b.cells.size());
  for (std::size_t k = 0; k < a.cells.size(); ++k) {
    EXPECT_EQ(a.cells[k].z, b.cells[k].z);
    EXPECT_EQ(a.cells[k].weight, b.cells[k].weight);
  }
}

TEST(FusedGround, IsTheSameToTheBitEachTime) {
  const Height rough = [](double x, double y) {
    return 0.1 * std::sin(3.1 * x) * std::cos(2.3 * y) + kerb_at(y, 0.2);
  };
  const FusedGround a = fused(rough, kBesideCar, {kCar});
  const FusedGround b = fused(rough, kBesideCar, {kCar});
  ASSERT_EQ(a.sheets().size(), b.sheets().size());
  for (std::size_t s = 0; s < a.sheets().size(); ++s) {
    for (std::size_t k = 0; k < GroundSheets::kNodes; ++k) {
      ASSERT_EQ(a.sheets()[s].nodes[k].z, b.sheets()[s].nodes[k].z);
      ASSERT_EQ(a.sheets()[s].nodes[k].confidence_255, b.sheets()[s].nodes[k].confidence_255);
    }
  }
}

TEST(FusedGround, RefusesToFinishTwiceAndFlagsOfAnotherScan) {
  FusedGround ground;
  ground.finish({});
  EXPECT_THROW(ground.finish({}), std::logic_error);
  EXPECT_THAT(
      [] {
        (void)reduce_ground(test::cloud_of({{1.0F, 0.0F, 0.0F}}), {}, {},
                            Eigen::Isometry3d::Identity());
      },
      ThrowsSaying<std::invalid_argument>({"ground flags: 0", "(1)"}));
}

TEST(BelowFused, IsStraightBelowAlongTheMapsZHoweverTheSensorIsTilted) {
  const Height slope = [](double x, double y) { return 0.08 * x - 0.02 * y; };
  const FusedGround ground = fused(slope);
  const Eigen::Isometry3d T_local_lidar = Eigen::Translation3d(1.0, -0.5, 1.9) *
                                          Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitZ()) *
                                          Eigen::AngleAxisd(0.12, Eigen::Vector3d(0.6, 0.8, 0.0));
  const BelowFused below(ground, T_local_lidar);
  const Eigen::Vector3d p_local(3.0, 2.0, 1.4);
  const auto foot = below.below((T_local_lidar.inverse() * p_local).cast<float>());
  ASSERT_TRUE(foot);
  EXPECT_NEAR(foot->height_m, 1.4 - slope(3.0, 2.0), 0.002);
  const Eigen::Vector3d foot_local = T_local_lidar * foot->position.cast<double>();
  EXPECT_LT((foot_local - Eigen::Vector3d(3.0, 2.0, slope(3.0, 2.0))).norm(), 0.002);
  EXPECT_FALSE(below.below({200.0F, 0.0F, 0.0F}));
}

TEST(BelowFused, TakesNoBridgeAboveForTheGroundOfWhatIsBelow) {
  const FusedGround deck = fused([](double, double) { return 5.0; });
  const BelowFused below(deck, Eigen::Isometry3d::Identity());
  EXPECT_FALSE(below.below({0.0F, 0.0F, 1.0F}));
  const auto foot = below.below({0.0F, 0.0F, 4.8F});
  ASSERT_TRUE(foot);
  EXPECT_NEAR(foot->height_m, -0.2, 0.001);
}

}  // namespace fused_ground_test
}  // namespace stillmap::mapping
