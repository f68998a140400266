#include "patching/tile_merge.hpp"
#include "patching/seam.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "support/synthetic_world.hpp"

namespace stillmap::mapping {
namespace tile_merge_test {

using maps::PointKind;
using maps::TileEvidence;

constexpr double kToleranceM = 0.15;

maps::MapPoint point(double x, double y, double z, PointKind kind = PointKind::kMeasured) {
  return {static_cast<float>(x), static_cast<float>(y), static_cast<float>(z), 1.0F, 1, kind, 0};
}

/// A tile without histories.
TileOfMap tile_of(std::vector<maps::MapPoint> points) { return {std::move(points), {}, {}}; }

/// What a drive saw: the cubes within half a metre of some points free, or hit.
TileEvidence evidence_of(std::uint32_t drive, const std::vector<Eigen::Vector3d>& free,
                         const std::vector<Eigen::Vector3d>& hit, int base_m = 0) {
  TileEvidence evidence{base_m, {{drive, {}, {}}}};
  const auto set = [&](const std::vector<Eigen::Vector3d>& places, TileEvidence::Cubes& cubes) {
    for (const Eigen::Vector3d& p : places)
      for (const double dx : {-0.5, 0.5})
        for (const double dy : {-0.5, 0.5})
          cubes.set(*evidence.cube_of(p + Eigen::Vector3d(dx, dy, 0.0)));
  };
  set(free, evidence.drives[0].free);
  set(hit, evidence.drives[0].hit);
  return evidence;
}

MergedTile merge(const TileOfMap& before, const TileOfMap& now) {
  std::vector<Eigen::Vector3f> measured, others;
  for (const maps::MapPoint& p : now.points)
    (maps::is_measured(p.kind) ? measured : others).emplace_back(p.x, p.y, p.z);
  return merged(before, now, {{measured, kToleranceM}, {others, kToleranceM}}, kToleranceM);
}

/// Heights of the points that a tile holds.
std::vector<float> heights(const TileOfMap& tile) {
  std::vector<float> heights;
  for (const maps::MapPoint& p : tile.points) heights.push_back(p.z);
  return heights;
}

TEST(TileMerge, PointsGiveWayToNewOnesAtTheirPlaceAndStayElsewhere) {
  const MergedTile out =
      merge(tile_of({point(5, 5, 1), point(5, 5, 3)}), tile_of({point(5, 5.1, 1.05)}));
  EXPECT_EQ(heights(out.tile), (std::vector<float>{3.0F, 1.05F}));
  EXPECT_EQ(out.counts.replaced, 1U);
  EXPECT_EQ(out.counts.kept, 1U);
  EXPECT_EQ(out.counts.added, 1U);
  EXPECT_EQ(out.counts.gone, 0U);
}

TEST(TileMerge, AnUnseenTileStaysAsItIs) {
  TileOfMap before = tile_of({point(1, 1, 1), point(9, 9, 0, PointKind::kGround)});
  before.evidence = evidence_of(0, {{4, 4, 1}}, {{1, 1, 1}});
  const MergedTile out = merge(before, {});
  EXPECT_EQ(out.counts.kept, 2U);
  EXPECT_EQ(out.tile.evidence.drives.size(), 1U);
  EXPECT_EQ(out.tile.evidence.drives[0].hit, before.evidence.drives[0].hit);
}

TEST(TileMerge, WhatStoodWhereNewDrivesSeeFreeSpaceIsGone) {
  TileOfMap now;
  now.evidence = evidence_of(1, {{5, 5, 1.5}}, {});
  const MergedTile out = merge(tile_of({point(5, 5, 1.5), point(12, 12, 1.5)}), now);
  EXPECT_EQ(out.counts.gone, 1U);
  EXPECT_EQ(out.counts.kept, 1U);
}

TEST(TileMerge, GroundIsNeverGoneAndNeitherIsWhatStandsBesideAHit) {
  TileOfMap now;
  now.evidence = evidence_of(1, {{5, 5, 0.5}, {12, 12, 0.5}}, {{12, 12, 0.5}});
  const MergedTile out =
      merge(tile_of({point(5, 5, 0.5, PointKind::kGround), point(12, 12, 0.5)}), now);
  EXPECT_EQ(out.counts.gone, 0U);
  EXPECT_EQ(out.counts.kept, 2U);
}

TEST(TileMerge, AThinThingBesideTheMiddleOfOneFreeCubeStays) {
  TileOfMap now;
  now.evidence = {0, {{1, {}, {}}}};
  // The cube around it alone, not those that it may stand at the border of.
  now.evidence.drives[0].free.set(*now.evidence.cube_of({5.9, 5.9, 1.5}));
  EXPECT_EQ(merge(tile_of({point(5.9, 5.9, 1.5)}), now).counts.gone, 0U);
}

TEST(TileMerge, MeasuredGroundStaysUnderWhatWasOnlyProjectedOrFilled) {
  const TileOfMap before =
      tile_of({point(3, 3, 0, PointKind::kGround), point(6, 6, 0, PointKind::kFilled)});
  const TileOfMap now =
      tile_of({point(3, 3, 0.02, PointKind::kProjected), point(6, 6, 0.02, PointKind::kProjected),
               point(6, 9, 0.02, PointKind::kFilled)});
  const MergedTile out = merge(before, now);
  EXPECT_EQ(heights(out.tile), (std::vector<float>{0.0F, 0.02F, 0.02F}));
  EXPECT_EQ(out.tile.points[0].kind, PointKind::kGround);
}

TEST(TileMerge, NewEvidenceStandsForTheOldWhereItSawAnything) {
  TileOfMap before, now;
  before.evidence = evidence_of(0, {{4, 4, 1.5}}, {{9, 9, 1.5}});
  // One layer of cubes lies below those of before.
  now.evidence = evidence_of(1, {{9, 9, 1.5}}, {}, -1);
  const TileEvidence out = merge(before, now).tile.evidence;
  ASSERT_EQ(out.drives.size(), 2U);
  EXPECT_EQ(out.base_m, -1);
  EXPECT_TRUE(out.free()[*out.cube_of({9.2, 9.2, 1.5})]);
  EXPECT_TRUE(out.free()[*out.cube_of({4.2, 4.2, 1.5})]);
  EXPECT_TRUE(out.drives[0].hit.none());
}

/// Ground, and walls along x and y, in 10 by 10 m, with the noise of a sensor.
TileOfMap corner(std::uint64_t seed, const Eigen::Vector3d& off_m, bool has_walls = true) {
  test::Random random(seed);
  TileOfMap tile;
  const auto add = [&](const Eigen::Vector3d& p, int axis, PointKind kind) {
    Eigen::Vector3d q = p + off_m;
    q[axis] += 0.01 * random.normal();
    tile.points.push_back(point(q.x(), q.y(), q.z(), kind));
    maps::PointHistory history{};
    history.normal[axis] = 127;
    history.planarity = 240;
    tile.history.push_back(history);
  };
  for (int i = 0; i < 4000; ++i) {
    const double a = random.uniform(0.5, 9.5), b = random.uniform(0.5, 9.5);
    add({a, b, 0.0}, 2, PointKind::kGround);
    if (!has_walls || i % 3 != 0) continue;
    add({a, 8.0, 0.3 * b}, 1, PointKind::kMeasured);
    add({2.0, a, 0.3 * b}, 0, PointKind::kMeasured);
  }
  return tile;
}

TEST(Seam, IsTheShiftOfTheSurfaces) {
  const Eigen::Vector3d off_m(0.05, -0.03, 0.02);
  const auto fit = seam_between(corner(1, Eigen::Vector3d::Zero()), corner(2, off_m), 0);
  ASSERT_TRUE(fit);
  EXPECT_LT((fit->off_m - off_m).norm(), 0.003) << fit->off_m.transpose();
  EXPECT_GT(fit->points, 4000U);
  EXPECT_LT(fit->sigma_m, 0.002);
  EXPECT_GT(fit->sure_m(), off_m.norm() - 0.008);
}

TEST(Seam, IsNoneBetweenTwoLooksAtTheSame) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const auto fit = seam_between(corner(seed, Eigen::Vector3d::Zero()),
                                  corner(100 + seed, Eigen::Vector3d::Zero()), 0);
    ASSERT_TRUE(fit);
    EXPECT_LT(fit->off_m.norm(), 0.003) << seed;
  }
}

TEST(Seam, IsToldBesideWhatHasChanged) {
  TileOfMap now = corner(2, {0.0, 0.0, 0.05});
  // A third of the ground has a new layer.
  for (maps::MapPoint& p : now.points)
    if (p.kind == PointKind::kGround && p.x < 3.5F) p.z += 0.12F;
  const auto fit = seam_between(corner(1, Eigen::Vector3d::Zero()), now, 0);
  ASSERT_TRUE(fit);
  EXPECT_NEAR(fit->off_m.z(), 0.05, 0.01);
}

TEST(Seam, SaysNothingOfDirectionsThatNoSurfaceTells) {
  const auto fit = seam_between(corner(1, Eigen::Vector3d::Zero(), false),
                                corner(2, {0.08, 0.08, 0.0}, false), 0);
  ASSERT_TRUE(fit);
  EXPECT_LT(fit->off_m.norm(), 0.003);
}

TEST(Seam, IsNotSureOfOneBushThatMoved) {
  // Few points tell of x, all in a square.
  TileOfMap before = corner(1, Eigen::Vector3d::Zero(), false);
  TileOfMap now = corner(2, Eigen::Vector3d::Zero(), false);
  test::Random random(3);
  for (TileOfMap* tile : {&before, &now}) {
    const double x = tile == &before ? 5.0 : 5.06;
    for (int i = 0; i < 1500; ++i) {
      tile->points.push_back(
          point(x + 0.03 * random.normal(), random.uniform(4.0, 4.9), random.uniform(0.3, 2.0)));
      maps::PointHistory history{};
      history.normal[0] = 127;
      history.planarity = 220;
      tile->history.push_back(history);
    }
  }
  const auto fit = seam_between(before, now, 0);
  ASSERT_TRUE(fit);
  EXPECT_LT(fit->sure_m(), 0.005);
}

TEST(Seam, NeedsPoints) {
  EXPECT_FALSE(seam_between(corner(1, Eigen::Vector3d::Zero()), {}, 0));
  // They lie in the first quarter.
  EXPECT_FALSE(
      seam_between(corner(1, Eigen::Vector3d::Zero()), corner(2, Eigen::Vector3d::Zero()), 3));
}

}  // namespace tile_merge_test
}  // namespace stillmap::mapping
