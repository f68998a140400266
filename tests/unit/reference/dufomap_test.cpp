#include "reference/dufomap.hpp"

#include "support/throws.hpp"
#include "unit/mapping/scans_in_memory.hpp"

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <limits>
#include <stdexcept>
#include <vector>

namespace stillmap::mapping {
namespace dufomap_test {

using test::ScanPattern;
using test::ScansInMemory;
using test::SyntheticWorld;
using test::ThrowsSaying;

constexpr double kGroundInVoxel_m = 0.05;

ScanPattern dense() {
  ScanPattern pattern;
  pattern.rings = 64;
  pattern.columns = 600;
  pattern.lowest_rad = -0.45;
  pattern.highest_rad = 0.10;
  pattern.max_range_m = 9.5;
  return pattern;
}

const SyntheticWorld::Box kLeaves{{4.03, -1.02, 0.0}, {5.53, 1.02, 1.5}};
const SyntheticWorld::Box kParked{{3.04, 3.54, 0.0}, {6.54, 5.04, 1.5}};

SyntheticWorld street() {
  SyntheticWorld world;
  world.boxes = {{{8.05, -12.0, 0.0}, {8.55, 12.0, 3.0}}, kParked};
  world.cylinders = {{{2.03, -4.04}, 0.1, 3.0}};
  return world;
}

/// A sensor that passes; the first two of its scans see a box that then leaves.
ScansInMemory drive() {
  const SyntheticWorld without = street();
  SyntheticWorld with = without;
  with.boxes.push_back(kLeaves);
  ScansInMemory scans;
  for (int k = 0; k < 4; ++k) {
    scans.add(k < 2 ? with : without, {-1.0 + 0.33 * k, 0.21 * k, 1.8}, dense());
  }
  scans.shift({0.0, 0.0, kGroundInVoxel_m});
  return scans;
}

bool inside(const SyntheticWorld::Box& box, const Eigen::Vector3f& p) {
  const Eigen::Vector3d q = p.cast<double>() - Eigen::Vector3d(0.0, 0.0, kGroundInVoxel_m);
  return (q.array() > box.min.array() - 0.02).all() && (q.array() < box.max.array() + 0.02).all();
}

std::vector<std::uint8_t> clean(const CleaningPoints& points, const ScanSource& scans) {
  const CancelFlag never{false};
  return DufomapCleaner().moved(points, scans, {}, never);
}

TEST(Dufomap, TakesTheBoxThatLeftAndNothingElse) {
  const ScansInMemory scans = drive();
  const CleaningPoints points = scans.points();
  const std::vector<std::uint8_t> moved = clean(points, scans);
  ASSERT_EQ(moved.size(), points.positions.size());
  std::size_t of_box = 0, of_parked = 0;
  for (std::size_t i = 0; i < moved.size(); ++i) {
    const Eigen::Vector3f& p = points.positions[i];
    if (inside(kLeaves, p)) {
      // The lowest voxels touch unknown ones below the ground.
      if (p.z() < 0.2F) continue;
      ++of_box;
      ASSERT_EQ(moved[i], 1) << p.transpose();
      continue;
    }
    of_parked += inside(kParked, p) ? 1 : 0;
    ASSERT_EQ(moved[i], 0) << p.transpose();
  }
  EXPECT_GT(of_box, 1000U);
  EXPECT_GT(of_parked, 1000U);
}

TEST(Dufomap, KeepsWhatNoRayReaches) {
  ScansInMemory scans = drive();
  CleaningPoints points;
  // Behind the wall, in the parked box, below the ground, above all rays.
  for (const Eigen::Vector3f& p : {Eigen::Vector3f(10.0F, 0.0F, 1.0F),
                                   {5.0F, 4.3F, 0.8F},
                                   {4.0F, 0.0F, -0.5F},
                                   {2.0F, 0.0F, 20.0F}}) {
    ScansInMemory::add_point(points, p);
  }
  EXPECT_EQ(clean(points, scans), std::vector<std::uint8_t>(4, 0));
  ScansInMemory::add_point(points, {4.5F, 0.0F, 1.0F});
  EXPECT_EQ(clean(points, scans).back(), 1) << "in the open";
}

TEST(Dufomap, StopsRaysAtObjectsThatAreNotInTheMap) {
  SyntheticWorld world = street();
  ScansInMemory scans;
  scans.add(world, {0.0, 0.0, 1.8}, dense());
  CleaningPoints points;
  ScansInMemory::add_point(points, {6.5F, 0.0F, 1.0F});
  EXPECT_EQ(clean(points, scans).front(), 1);
  world.boxes.push_back(kLeaves);
  scans.scans.clear();
  scans.add(world, {0.0, 0.0, 1.8}, dense());
  PosedScan& scan = scans.scans.front();
  for (std::size_t i = 0; i < scan.positions.size(); ++i) {
    scan.in_object[i] = std::abs(scan.positions[i].x() - 4.03F) < 0.1F ? 1 : 0;
  }
  EXPECT_EQ(clean(points, scans).front(), 0) << "it lies behind the object";
}

TEST(Dufomap, OneScanRemovesNothingOfItself) {
  ScansInMemory scans = drive();
  scans.scans.resize(1);
  const std::vector<std::uint8_t> moved = clean(scans.points(), scans);
  EXPECT_EQ(std::count(moved.begin(), moved.end(), 1), 0);
}

TEST(Dufomap, NeedsObservedNeighboursAndAllowsForNoise) {
  // A fan of rays that fills a wedge of space; the point lies in its middle.
  ScansInMemory scans;
  std::vector<Eigen::Vector3f> wall;
  for (int y = -8; y <= 8; ++y) {
    for (int z = -8; z <= 8; ++z) {
      wall.emplace_back(4.05F, 0.1F * static_cast<float>(y), 0.1F * static_cast<float>(z));
    }
  }
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() = Eigen::Vector3d(0.05, 0.05, 0.05);
  scans.add(T, wall);
  CleaningPoints points;
  ScansInMemory::add_point(points, {3.75F, 0.05F, 0.05F});
  ScansInMemory::add_point(points, {3.75F, 0.75F, 0.05F});
  ScansInMemory::add_point(points, {4.05F, 0.05F, 0.05F});
  const CancelFlag never{false};
  const auto with = [&](double hit_distance_m, int unknown_voxels) {
    return DufomapCleaner({.hit_distance_m = hit_distance_m, .unknown_voxels = unknown_voxels})
        .moved(points, scans, {}, never);
  };
  EXPECT_EQ(with(0.2, 1), (std::vector<std::uint8_t>{1, 0, 0})) << "the second is at the edge";
  EXPECT_EQ(with(0.2, 0), (std::vector<std::uint8_t>{1, 1, 0}));
  EXPECT_EQ(with(0.5, 0), (std::vector<std::uint8_t>{0, 0, 0})) << "both may be noise of the wall";
}

TEST(Dufomap, GivesTheSameForAnyThreadsAndAnyOrderOfScans) {
  ScansInMemory scans = drive();
  const CleaningPoints points = scans.points();
  std::vector<std::uint8_t> first, second;
  // Four threads, however many cores there are.
  const tbb::global_control allow(tbb::global_control::max_allowed_parallelism, 4);
  tbb::task_arena(1).execute([&] { first = clean(points, scans); });
  std::reverse(scans.scans.begin(), scans.scans.end());
  tbb::task_arena(4).execute([&] { second = clean(points, scans); });
  EXPECT_EQ(first, second);
  EXPECT_GT(std::count(first.begin(), first.end(), 1), 0);
}

TEST(Dufomap, TakesEmptyMapsAndNoScans) {
  const ScansInMemory scans = drive();
  EXPECT_TRUE(clean({}, scans).empty());
  const CleaningPoints points = scans.points();
  EXPECT_EQ(clean(points, ScansInMemory()), std::vector<std::uint8_t>(points.positions.size(), 0));
  ScansInMemory empty;
  empty.add(Eigen::Isometry3d::Identity(), {});
  EXPECT_EQ(clean(points, empty), std::vector<std::uint8_t>(points.positions.size(), 0));
}

TEST(Dufomap, TellsEveryScanAndEndsWhenCancelled) {
  const ScansInMemory scans = drive();
  const CleaningPoints points = scans.points();
  CancelFlag cancel{false};
  std::vector<std::size_t> done;
  const auto progress = [&](std::string_view stage, std::size_t scan, std::size_t total) {
    EXPECT_EQ(stage, "clean");
    EXPECT_EQ(total, scans.size());
    done.push_back(scan);
  };
  (void)DufomapCleaner().moved(points, scans, progress, cancel);
  EXPECT_EQ(done, (std::vector<std::size_t>{1, 2, 3, 4}));
  cancel = true;
  EXPECT_THROW((void)DufomapCleaner().moved(points, scans, {}, cancel), Cancelled);
}

TEST(Dufomap, RefusesBrokenOptionsByName) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto making = [](const DufomapOptions& options) {
    return [options] { const DufomapCleaner cleaner(options); };
  };
  using Wrong = std::invalid_argument;
  for (const double bad : {nan, 0.0, -0.1, 11.0}) {
    EXPECT_THAT(making({.voxel_m = bad}), ThrowsSaying<Wrong>({"voxel_m"}));
  }
  for (const double bad : {nan, -0.1, 11.0}) {
    EXPECT_THAT(making({.hit_distance_m = bad}), ThrowsSaying<Wrong>({"hit_distance_m"}));
  }
  for (const int bad : {-1, 8}) {
    EXPECT_THAT(making({.unknown_voxels = bad}), ThrowsSaying<Wrong>({"unknown_voxels"}));
  }
  EXPECT_THAT(making({.voxel_m = nan, .hit_distance_m = nan, .unknown_voxels = -1}),
              ThrowsSaying<Wrong>({"voxel_m", "hit_distance_m", "unknown_voxels"}));
}

TEST(Dufomap, RefusesPointsThatNoMapHas) {
  CleaningPoints points;
  ScansInMemory::add_point(points, {std::numeric_limits<float>::quiet_NaN(), 0.0F, 0.0F});
  EXPECT_THROW((void)clean(points, drive()), std::invalid_argument);
}

}  // namespace dufomap_test
}  // namespace stillmap::mapping
